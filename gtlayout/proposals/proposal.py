"""Plain data: what is proposed to be drawn in one frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from shapely import MultiPolygon

from gtlayout.io.annotations.drafts import Draft
from gtlayout.scene import Element, FloatArray, KeyFrame

EdgeKind = Literal["contact", "occlusion", "side", "open", "border"]


@dataclass(frozen=True)
class ProposedEdge:
    """One edge of the outline of a proposed element."""

    start_px: FloatArray
    """(2,)"""
    end_px: FloatArray
    """(2,)"""
    kind: EdgeKind
    """A contact of two planes; an occlusion, where one plane ends before another; a side of an opening or of a surface
    that ends by itself; open, when it ends there only because nothing was seen further; the border of the image."""
    sigma_px: float
    """σ of the line, across it: from the joint covariance of the planes, and what drawing itself leaves; 0 on the
    border of the image, infinite for open edges."""
    confidence: float
    """Probability that a person would leave it as it is."""
    unsnapped_px: FloatArray | None = None
    """(2, 2) where it was before it was moved to a line of the image; None when it was not moved."""


@dataclass(frozen=True)
class ProposedElement:
    """One instance as it would be drawn."""

    element: Element
    """Its id is the instance's name."""
    instance: int
    """Index in the layout."""
    edges: tuple[ProposedEdge, ...]
    """Of the amodal outline: polygon by polygon, outer ring first, in the rings' order."""
    score: float
    """Mean confidence of the edges by their length, 0 to 1, for tools that show scores."""


@dataclass(frozen=True)
class Proposal:
    """What would be drawn in one frame."""

    frame: int
    """Index into ``Scene.frames``."""
    elements: tuple[ProposedElement, ...]
    """In order of their instances."""
    occlusion_edges: tuple[FloatArray, ...]
    """(N, 2) px polylines."""
    uncovered: MultiPolygon
    """Where in the image nothing is proposed, px."""

    def key_frame(self) -> KeyFrame:
        """The same as if a person had drawn it."""
        return KeyFrame(self.frame, tuple(proposed.element for proposed in self.elements), self.occlusion_edges)

    def draft(self) -> Draft:
        """The same as readers and writers know it."""
        return Draft(self.key_frame(), {proposed.element.id: proposed.score for proposed in self.elements})
