"""What is measured of a layout: against the elements, and by its covariances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Verdict = Literal["ok", "weak", "unobservable"]


Prediction = Literal["trustworthy", "doubtful"]


@dataclass(frozen=True)
class ElementIoU:
    """One annotated element, with the doors and windows in it, against the rendering of its instance."""

    key_frame: int
    element: int
    instance: int
    iou: float


@dataclass(frozen=True)
class InstanceQuality:
    """The verdict on one instance, and the measures behind it."""

    iou: float
    """Mean over the key frames that show it."""
    sigma_normal_deg: float
    sigma_depth: float
    """σ of its depth at the centroid of its largest element, world unit."""
    depth: float
    """That depth, world unit."""
    verdict: Verdict
    reason: str
    """Why it is not ok; empty when it is."""
    causes: tuple[str, ...] = ()
    """What makes it uncertain, the most important first; empty when it is certain enough or the cause is not known."""
    drawn_share: float = 0.0
    """Share of all drawn pixels that lie on it."""
    reach: float = np.nan
    """How far its extent reaches from the nearest camera that it was drawn in, as a multiple of the room's size; NaN
    without extent, or when no depth is known. The size of the room is the distance within which 95 % of the known
    pixels lie."""


@dataclass(frozen=True)
class Measures:
    """What is measured of a layout: against the elements, and by its covariances."""

    iou: float
    """Mean over the key frames of the mean over their structural elements. Doors and windows count as part of the wall
    they lie in, as in the CAD-Estate release, which stores them so; ``openings_iou`` judges them alone.
    """
    accepted: bool
    """Whether the IoU is high enough."""
    sigma_depth_share: float
    """Predicted σ of depth as a share of the depth: mean over all drawn pixels, 1 where nothing is known."""
    predicted: Prediction
    """The verdict of the covariances alone."""
    known_share: float
    """Share of the drawn pixels whose depth is known."""
    openings_iou: float | None
    """Mean IoU of the doors and windows that have a host; None when there are none."""
    frames: tuple[float, ...]
    """Mean IoU of each key frame; NaN for one that shows nothing but doors and windows."""
    elements: tuple[ElementIoU, ...]
    """Every annotated element."""
    instances: tuple[InstanceQuality, ...]
    """One per instance."""
    worst_frame: int
    """Index of the key frame with the lowest IoU."""
    worst_element: int
    """Index into ``elements`` of the lowest IoU: the one to redraw first."""
