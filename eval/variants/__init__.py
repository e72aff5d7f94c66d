"""Scenes in other forms, and spoiled ones, and how they are measured."""
