"""The page of a whole run, and the comparison of two."""
