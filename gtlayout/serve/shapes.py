"""A proposal as annotation tools take it: outlines and lines with labels, in the image that the tool shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gtlayout.io.annotations.labels import Kind
from gtlayout.io.annotations.masks import simple_rings
from gtlayout.io.annotations.outlines import View
from gtlayout.proposals.proposal import Proposal, ProposedElement
from gtlayout.scene import OPENINGS, FloatArray


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
    """Of its element; of an occlusion edge that of the whole proposal."""
    text: tuple[Literal["id", "element"], str] | None = None
    """The text field and what is in it: the id of an element, or the element that a visible part belongs to."""


def score_of(proposal: Proposal) -> float:
    """The mean of its elements' scores; 0 for none."""
    return float(np.mean([each.score for each in proposal.elements])) if proposal.elements else 0.0


def tool_shapes(proposal: Proposal, view: View) -> tuple[ToolShape, ...]:
    """Elements, openings after what they lie in, then visible parts and occlusion edges, so that none is covered.

    An element with holes or of several parts is several polygons, which share its id. Points are clipped to the image.
    """
    ordered = sorted(proposal.elements, key=lambda each: each.element.label in OPENINGS)
    return (
        *(shape for each in ordered for shape in _outlines(each, view)),
        *(shape for each in ordered for shape in _visible(each, view)),
        *(
            ToolShape(f"occlusion_edge-{i}", "polyline", "occlusion_edge", _drawn(line, view), score_of(proposal))
            for i, line in enumerate(proposal.occlusion_edges)
        ),
    )


def _outlines(proposed: ProposedElement, view: View) -> Iterator[ToolShape]:
    element = proposed.element
    for i, ring in enumerate(simple_rings(element.amodal)):
        text: tuple[Literal["id"], str] = ("id", element.id)
        yield ToolShape(f"{element.id}-{i}", "polygon", element.label, _drawn(ring, view), proposed.score, text)


def _visible(proposed: ProposedElement, view: View) -> Iterator[ToolShape]:
    element = proposed.element
    for i, ring in enumerate(simple_rings(element.visible)):
        text: tuple[Literal["element"], str] = ("element", element.id)
        yield ToolShape(f"{element.id}-visible-{i}", "polygon", "visible", _drawn(ring, view), proposed.score, text)


def _drawn(points_px: FloatArray, view: View) -> FloatArray:
    return np.clip(view.to_drawn(points_px), 0.0, view.annotated_size)
