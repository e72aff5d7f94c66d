"""COCO and its kin."""
