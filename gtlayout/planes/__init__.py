"""Stage 4: the plane of every instance, with its uncertainty, from one factor graph (paper 3.3)."""
