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
    simplify_px: float = 1.0
    """Corners nearer than this to the line through their neighbours are left out: nobody draws them."""
    min_area: float = 0.0008
    """Elements and pieces of elements below this share of the image are not proposed."""
    min_width_px: float = 4.0
    """Nor are those narrower than this: they are gaps between outlines."""
    left_px: float = 5.0
    """An edge is right, and is left as it is, when it lies within this of where a person draws it."""
    drawing_sigma_px: float = 2.0
    """σ across a line that remains when the planes are known exactly: of the hand, and of the cameras."""
    prediction: PredictionConfig = field(default_factory=PredictionConfig)
    """What counts as an occlusion edge."""
