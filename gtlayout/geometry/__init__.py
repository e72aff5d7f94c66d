"""Polygons, pixels, and planes seen by cameras, for all stages after tracking."""
