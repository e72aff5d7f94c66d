"""Cameras from every form in which people have them: one reader a file."""
