"""Settings of proposals."""

from __future__ import annotations

from dataclasses import dataclass, field

from gtlayout.prediction.config import PredictionConfig
from gtlayout.scene import SAME_BORDER_PX


@dataclass(frozen=True)
class ProposalConfig:
    """What is proposed. Pixels are those of an image of 640x480; see ``Camera.annotation_scale`` for others."""

    same_border_px: float = SAME_BORDER_PX
    """Two outlines that are closer than this have a border in common."""
    mode: int = 1
    least_motion: float = 0.02
    """Share of the image's size …"""
    nearness: float = 2.0
    """Power."""
    gap_px: float = 12.0
    """Gaps between two outlines up to this width are closed."""
    simplify_px: float = 3.0
    """Corners nearer than this to the line through their neighbours are left out: nobody draws them."""
    min_area: float = 0.0008
    """Elements and pieces of elements below this share of the image are not proposed."""
    min_width_px: float = 4.0
    """Nor are those narrower than this: they are gaps between outlines."""
    reach_depths: float = 6.0
    """What is not seen ends at the latest so many median depths from what is."""
    simplify_share: float = 0.01
    """Of the square root of a region's area: corners that deviate less are left out before it is filled."""
    closed_px: float = 8.0
    """A surface ends where a key frame shows its boundary this near, …"""
    border_px: float = 4.0
    """… at least so far within the image."""
    min_closed_share: float = 0.04
    """Of the square root of a region's area: shorter edges say nothing of where it ends."""
    left_px: float = 5.0
    """An edge is right, and is left as it is, when it lies within this of where a person draws it."""
    drawing_sigma_px: float = 2.0
    """σ across a line that remains when the planes are known exactly: of the hand, and of the cameras."""
    prediction: PredictionConfig = field(default_factory=PredictionConfig)
    """What counts as an occlusion edge."""
