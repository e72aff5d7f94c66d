"""Lengths, areas and volumes of a solved room with their σ, and the level of accuracy that each reaches."""
