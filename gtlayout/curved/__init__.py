"""Walls that bend: upright cylinders in place of planes, after the planes are solved."""
