"""Stage 1: points on the visible parts of key frames, followed through the video or found again, and triangulated."""
