"""Stage 5: the finite part of its plane that each instance covers (paper 3.4), and the dimensions of the room."""
