"""Cameras from every known format: one reader per file."""
