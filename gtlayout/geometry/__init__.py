"""Polygons, pixels, planes seen by cameras: what every stage after tracking measures with."""
