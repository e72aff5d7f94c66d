"""Settings of predicting a drawing, and of matching one with it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PredictionConfig:
    """What a camera must see of a layout, and which drawn element is what."""

    min_depth_jump: float = 0.05
    """Neighbours in the image do not touch where one lies behind the other by more than this share of its depth."""
    min_iou: float = 0.5
    """An element is matched to an instance only with at least this IoU of the drawn and the predicted region."""
    other_label_price: float = 0.3
    """IoU that a match of different labels must be better by than one of equal labels."""
