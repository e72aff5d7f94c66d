"""Settings of stage 5; regrouping uses them, too."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ExtentConfig:
    """Stage 5; regrouping uses it, too."""

    max_growth: float = 0.10
    """Refinement extends an extent to its neighbour's plane when its area grows by at most this share (paper 3.4)."""
    max_cut: float = 0.10
    """Refinement cuts off a piece beyond the neighbour's plane that is at most this share of the area (paper 3.4)."""
    min_angle_deg: float = 10.0
    """Extents are not refined to a plane that meets theirs at less than this angle."""
    max_depth_ratio: float = 10.0
    """A key frame's element is clipped where its plane is farther than this multiple of the scene's median depth."""
    min_horizon_px: float = 10.0
    """A key frame's element is also clipped this near to the plane's horizon: there a pixel moves the point by a tenth
    of its depth."""
    max_sigma_depth_share: float = 0.5
    """An extent ends where the σ of its depth exceeds this share of the depth, and ``max_sigma_growth`` is exceeded.
    From there on two σ of the inverse depth reach zero, so the plane may be at infinity."""
    max_sigma_growth: float = 2.0
    """An extent reaches at least to this multiple of its least σ, so that one that is known nowhere is not empty."""
    occluder_margin: float = 0.05
    """What is drawn nearer than a plane by more than this share of its depth may hide it. All else contradicts it."""
    min_piece: float = 0.005
    """Separate pieces and holes below this share of an extent's area are gaps between drawn polygons: dropped."""
    arc_segments: int = 16
    """Lines to a quarter of a circle, in what lies near a contact."""
