"""Stage 7: how good a layout is, which parts of it to trust, and the reasons."""
