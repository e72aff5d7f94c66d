"""Tunables of stages 5 and 6."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ExtentConfig:
    """Stages 5 and 6."""

    max_growth: float = 0.10
    """Refinement extends an element to its neighbour's plane when its area grows by at most this share (paper 3.4)."""
    max_cut: float = 0.10
    """… and cuts a piece beyond the neighbour's plane when it is less than this share of the area (paper 3.4)."""
    min_angle_deg: float = 10.0
    """Planes that meet at less than this angle have no intersection line worth refining to."""
    max_depth_ratio: float = 10.0
    """A key frame's polygon is clipped where its plane is farther than so many times the scene's median depth."""
    min_horizon_px: float = 10.0
    """… and where it comes this near to the plane's horizon: a pixel there moves the point by a tenth of its depth."""
    max_sigma_depth_share: float = 0.5
    """An element ends where the σ of its depth is more than this share of the depth: from there on two σ of the inverse
    depth reach zero, and the surface may be anywhere from the camera to infinity …"""
    max_sigma_growth: float = 2.0
    """… and more than so many times the least on it: what is known nowhere keeps the shape that was drawn."""
    occluder_margin: float = 0.05
    """What is drawn nearer than a plane by more than this share of its depth may hide it, all else contradicts it."""
    min_piece: float = 0.005
    """Separate pieces and holes below this share of an element's area are gaps between drawn polygons: dropped."""
