"""Annotations from every known tool: one reader per file."""
