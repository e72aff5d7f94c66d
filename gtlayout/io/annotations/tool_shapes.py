"""A draft as annotation tools take it: outlines and lines with labels, in the image that the tool shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gtlayout.io.annotations.drafts import Draft
from gtlayout.io.annotations.labels import Kind
from gtlayout.io.annotations.masks import simple_rings
from gtlayout.io.annotations.outlines import View
from gtlayout.scene import OPENINGS, Element, FloatArray


@dataclass(frozen=True)
class ToolShape:
    """One thing to draw, as in our label configurations."""

    name: str
    """Unique in its image."""
    kind: Literal["polygon", "polyline"]
    label: Kind
    points_px: FloatArray
    """(N, 2) px of the image as the tool shows it; without the closing point."""
    score: float
    """Of its element; of an occlusion edge that of the whole draft."""
    text: tuple[Literal["id", "element"], str] | None = None
    """The text field and what is in it: the id of an element, or the element that a visible part belongs to."""


def tool_shapes(draft: Draft, view: View) -> tuple[ToolShape, ...]:
    """Elements, openings after what they lie in, then visible parts and occlusion edges, so that none is covered.

    An element with holes or of several parts is several polygons, which share its id. Points are clipped to the image.
    """
    ordered = sorted(draft.key_frame.elements, key=lambda element: element.label in OPENINGS)
    return (
        *(shape for element in ordered for shape in _outlines(element, draft.scores[element.id], view)),
        *(shape for element in ordered for shape in _visible(element, draft.scores[element.id], view)),
        *(
            ToolShape(f"occlusion_edge-{i}", "polyline", "occlusion_edge", _drawn(line, view), draft.score)
            for i, line in enumerate(draft.key_frame.occlusion_edges)
        ),
    )


def _outlines(element: Element, score: float, view: View) -> Iterator[ToolShape]:
    for i, ring in enumerate(simple_rings(element.amodal)):
        text: tuple[Literal["id"], str] = ("id", element.id)
        yield ToolShape(f"{element.id}-{i}", "polygon", element.label, _drawn(ring, view), score, text)


def _visible(element: Element, score: float, view: View) -> Iterator[ToolShape]:
    for i, ring in enumerate(simple_rings(element.visible)):
        text: tuple[Literal["element"], str] = ("element", element.id)
        yield ToolShape(f"{element.id}-visible-{i}", "polygon", "visible", _drawn(ring, view), score, text)


def _drawn(points_px: FloatArray, view: View) -> FloatArray:
    return np.clip(view.to_drawn(points_px), 0.0, view.annotated_size)
