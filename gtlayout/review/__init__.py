"""Which drawing is wrong: each key frame against itself, and against what all others say of it."""
