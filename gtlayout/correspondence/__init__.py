"""Stage 2: which elements of different key frames show one instance."""
