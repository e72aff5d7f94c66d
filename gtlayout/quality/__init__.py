"""Stage 7: how good a layout is, which of it to trust, and why not."""
