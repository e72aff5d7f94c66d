"""Stage 2: which elements of different key frames are one instance."""
