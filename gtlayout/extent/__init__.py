"""Stage 5: the finite part of its plane that each instance covers (paper 3.4)."""
