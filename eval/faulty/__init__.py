"""What may be wrong with a scene, its results or its place, and what the user then sees: the cases of ``faults.py``."""
