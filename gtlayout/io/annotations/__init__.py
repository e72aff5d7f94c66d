"""Annotations from every tool they are drawn with: one reader a file."""
