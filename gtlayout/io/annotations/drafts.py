"""Proposed drawings, which count for nothing until a person confirms them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.io.annotations.outlines import View
from gtlayout.scene import Frame, KeyFrame


@dataclass(frozen=True)
class Draft:
    """What is proposed for one frame."""

    key_frame: KeyFrame
    """In pixels of the frame's pinhole camera."""
    scores: Mapping[str, float]
    """0 to 1, by element."""

    @property
    def score(self) -> float:
        """The mean of its elements' scores; 0 for none."""
        return float(np.mean(list(self.scores.values()))) if self.scores else 0.0


def as_drawn(key_frame: KeyFrame, view: View) -> KeyFrame:
    """The same in pixels of the image that ``view`` says is drawn on. Corners are moved, sides stay straight."""

    def moved(region: MultiPolygon) -> MultiPolygon:
        return shapely.transform(region, view.to_drawn)

    return replace(
        key_frame,
        elements=tuple(
            replace(element, amodal=moved(element.amodal), visible=moved(element.visible))
            for element in key_frame.elements
        ),
        occlusion_edges=tuple(view.to_drawn(line) for line in key_frame.occlusion_edges),
    )


def on_shown_image(draft: Draft, frame: Frame) -> tuple[Frame, Draft]:
    """The draft in pixels of the image as a viewer shows it, and the frame with a camera of that size, for writers."""
    view = View.of(frame.name, frame, None)
    width, height = view.shown_size
    shown = replace(frame, camera=replace(frame.camera, width=width, height=height))
    return shown, replace(draft, key_frame=as_drawn(draft.key_frame, view))
