"""Settings of stage 2."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CorrespondenceConfig:
    """Stage 2."""

    min_votes: float = 3.0
    """Least number of votes, in tracks, for two elements to become one instance."""
    carried_weight: float = 8.0
    """Votes, in tracks, when all points of an element, at the depth of the tracks around them, land on another."""
    carried_points: int = 40
    """Points spread over an element for such votes."""
    depth_neighbours: int = 8
    """Number of tracks whose median depth such a point takes."""
    max_relative_sigma: float = 0.15
    """Tracks with a larger σ of depth than this share of the depth are not used for that."""
