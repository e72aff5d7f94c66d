"""Settings of proposals."""

from __future__ import annotations

from dataclasses import dataclass, field

from gtlayout.prediction.config import PredictionConfig
from gtlayout.scene import SAME_BORDER_PX


@dataclass(frozen=True)
class FillConfig:
    """How far a surface goes beyond what was drawn of it. Pixels are those of an image of 640x480."""

    reach_depths: float = 6.0
    """What is not seen ends at the latest so many median depths from what is."""
    simplify_share: float = 0.01
    """Of the square root of a region's area: corners that deviate less are left out before it is filled."""
    closed_px: float = 8.0
    """A surface ends where a key frame shows its boundary this near, …"""
    border_px: float = 4.0
    """… at least so far within the image, …"""
    hiding_px: float = 4.0
    """… unless something nearer than the surface is drawn this near: that only hides the rest."""
    occluder_margin: float = 0.05
    """Nearer by more than this share of its depth, that is."""
    min_closed_share: float = 0.04
    """Of the square root of a region's area: shorter edges say nothing of where it ends."""
    parallel_cos: float = 0.9
    """Doors and windows go on only between two edges whose directions differ by no more than this cosine."""


@dataclass(frozen=True)
class SnapConfig:
    """Which lines of the image edges are moved to. Pixels are those of the image, whatever its size."""

    reach_px: float = 8.0
    """An edge is moved to a line at most so far away, …"""
    angle_deg: float = 4.0
    """… in this direction, …"""
    group_px: float = 2.0
    """… made of segments whose distances from the edge differ by at most this, …"""
    min_coverage: float = 0.5
    """… which cover this share of the edge. With less of it in sight, other lines win as often as the right one."""
    near_px: float = 6.0
    """Of two lines the nearer is preferred: σ of the distance."""
    min_length_px: float = 15.0
    """Shorter edges are not moved."""


@dataclass(frozen=True)
class ProposalConfig:
    """What is proposed. Pixels are those of an image of 640x480; see ``Camera.annotation_scale`` for others."""

    least_motion: float = 0.02
    """By how much of its size an image moves at least from one key frame to another: the errors of the drawings."""
    nearness: float = 2.0
    """Key frames vote on extents with a weight of one over this power of the motion of the image from theirs: the
    drawings nearby say best where a line lies."""
    gap_px: float = 12.0
    """Gaps between two outlines up to this width are closed."""
    simplify_px: float = 3.0
    """Corners nearer than this to the line through their neighbours are left out: nobody draws them."""
    simplify_opening_px: float = 6.0
    """The same for doors and windows, whose sides are straight: the key frames' votes leave steps."""
    min_area: float = 0.0008
    """Elements and pieces of elements below this share of the image are not proposed."""
    min_width_px: float = 4.0
    """Nor are those narrower than this: they are gaps between outlines."""
    same_border_px: float = SAME_BORDER_PX
    """Two outlines that are closer than this have a border in common."""
    left_px: float = 5.0
    """An edge is right, and is left as it is, when it lies within this of where a person draws it."""
    drawing_sigma_px: float = 2.0
    """σ across a line that remains when the planes are known exactly: of the hands, and of the cameras."""
    prediction: PredictionConfig = field(default_factory=PredictionConfig)
    """What counts as an occlusion edge."""
    fill: FillConfig = field(default_factory=FillConfig)
    """Beyond what was drawn."""
    snap: SnapConfig = field(default_factory=SnapConfig)
    """Lines of the image."""
