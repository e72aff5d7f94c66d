"""Tunables of stage 2."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CorrespondenceConfig:
    """Stage 2."""

    min_votes: float = 3.0
    """Two elements become one instance from so many tracks on."""
    carried_weight: float = 8.0
    """What it counts, in tracks, that all of an element lands on another with the depth of the tracks around it."""
    carried_points: int = 40
    """Points spread over an element for that."""
    depth_neighbours: int = 8
    """Tracks whose median depth such a point takes."""
    max_relative_sigma: float = 0.15
    """Tracks whose depth is known less well than this share of it do not lend it."""
