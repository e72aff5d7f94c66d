"""Stage 1: points are sampled on the visible parts of key frames, followed through the video and triangulated."""
