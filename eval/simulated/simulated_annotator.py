"""A person who corrects proposals until they are what was drawn by hand: what that takes, in edges, vertices, clicks.

What is within reach of the person's own drawing is left as it is proposed, to the pixel; all else becomes the person's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from common.drawn_outlines import distances_px, inner_edges, matched_elements
from gtlayout.scene import Camera, FloatArray, KeyFrame


@dataclass(frozen=True)
class Effort:
    """What it takes to draw one or more key frames."""

    edges: int = 0
    """That a person drew, without those on the border of the image."""
    untouched: int = 0
    """Of these, those that lie where they are proposed, throughout."""
    moved: int = 0
    """Vertices that are dragged to their place."""
    placed: int = 0
    """Vertices that are set anew."""
    removed: int = 0
    """Vertices that are proposed in a wrong place and not needed; whole elements count as one."""
    other: int = 0
    """Clicks that begin an element, mark or unmark an occlusion edge, and confirm the drawing."""

    @property
    def clicks(self) -> int:
        """All clicks and drags."""
        return self.moved + self.placed + self.removed + self.other

    def __add__(self, more: Effort) -> Effort:
        return Effort(*(a + b for a, b in zip(vars(self).values(), vars(more).values(), strict=True)))


def drawn_by_hand(wanted: KeyFrame, camera: Camera) -> Effort:
    """What a key frame takes without a proposal: a click for each vertex, and those that begin, mark and confirm."""
    placed = sum(len(ring) for element in wanted.elements for ring in _rings(element.amodal))
    return Effort(
        edges=sum(len(inner_edges(element.amodal, camera)) for element in wanted.elements),
        placed=placed,
        other=len(wanted.elements) + len(wanted.occlusion_edges) + 1,
    )


def corrected(proposed: KeyFrame, wanted: KeyFrame, camera: Camera, reach_px: float) -> tuple[KeyFrame, Effort]:
    """The key frame that a person makes of a proposal, and what that takes.

    It has the elements, labels, visible parts and occlusion edges of ``wanted``, which the person would have drawn
    alone, in that order. ``reach_px``, as of an image of 640x480, is how far a line may be off for it to be left as it
    is. What it takes to mark visible parts is not counted, with or without a proposal.
    """
    reach = reach_px * camera.annotation_scale
    _, pairs = matched_elements(proposed.elements, wanted.elements, same_label=False)
    partner = {w: proposed.elements[p] for w, p in pairs.items()}
    effort = Effort(removed=len(proposed.elements) - len(partner), other=1)
    elements = []
    for e, element in enumerate(wanted.elements):
        if e in partner:
            outline, more = _corrected_outline(partner[e].amodal, element.amodal, camera, reach)
            # A wrong label is one click.
            effort += replace(more, other=int(partner[e].label != element.label))
            elements.append(replace(element, amodal=outline))
        else:
            by_hand = drawn_by_hand(KeyFrame(wanted.frame, (element,)), camera)
            effort += replace(by_hand, other=1)
            elements.append(element)
    effort += Effort(other=_toggled(proposed.occlusion_edges, wanted.occlusion_edges, reach))
    return replace(wanted, elements=tuple(elements)), effort


def _corrected_outline(
    proposed: MultiPolygon, wanted: MultiPolygon, camera: Camera, reach: float
) -> tuple[MultiPolygon, Effort]:
    """The outline after correction: vertices within reach of a proposed one are that, others those that are wanted."""
    corners = np.concatenate([np.empty((0, 2)), *_rings(proposed)])
    free = np.ones(len(corners), dtype=bool)
    placed = 0
    polygons = []
    for polygon in wanted.geoms:
        rings = []
        for ring in _rings(MultiPolygon([polygon])):
            kept = []
            for number, vertex in enumerate(ring):
                away = np.where(free, np.linalg.norm(corners - vertex, axis=1), np.inf)
                nearest = int(np.argmin(away)) if len(away) else -1
                if nearest >= 0 and away[nearest] <= reach:
                    free[nearest] = False
                    kept.append(corners[nearest])
                elif not _is_on_line(ring, number, proposed, reach):
                    placed += 1
                    kept.append(vertex)
            rings.append(kept)
        made = Polygon(rings[0], [hole for hole in rings[1:] if len(hole) > 2]) if len(rings[0]) > 2 else polygon
        polygons.append(made if made.is_valid and made.area > 0 else polygon)
    outline = MultiPolygon(polygons)
    if not outline.is_valid:
        outline = wanted
    # Corners that are left over are dragged to where one is wanted; others are in the way, unless on a line.
    over = corners[free]
    moved = min(placed, len(over))
    removed = max(sum(_far(corner, wanted, reach) for corner in over) - moved, 0)
    edges = inner_edges(wanted, camera)
    untouched = sum(bool(distances_px(edge, proposed).max() <= reach) for edge in edges)
    return outline, Effort(len(edges), untouched, moved, placed - moved, removed)


def _is_on_line(ring: FloatArray, number: int, proposed: MultiPolygon, reach: float) -> bool:
    """Whether a vertex is not needed: nearly on the line through its neighbours, which is proposed there."""
    before, vertex, after = ring[number - 1], ring[number], ring[(number + 1) % len(ring)]
    chord = shapely.linestrings([before, after])
    return bool(
        shapely.distance(chord, shapely.points(vertex)) <= reach / 2
        and shapely.distance(proposed.boundary, shapely.points(vertex)) <= reach
    )


def _far(corner: FloatArray, wanted: MultiPolygon, reach: float) -> bool:
    return bool(shapely.distance(wanted.boundary, shapely.points(corner)) > reach)


def _toggled(proposed: Sequence[FloatArray], wanted: Sequence[FloatArray], reach: float) -> int:
    """How many occlusion edges are marked or unmarked: those of either that lie along none of the other, for the most
    part.
    """
    return _without(proposed, wanted, reach) + _without(wanted, proposed, reach)


def _without(lines: Sequence[FloatArray], others: Sequence[FloatArray], reach: float) -> int:
    around = shapely.union_all([shapely.linestrings(other) for other in others if len(other) > 1]).buffer(reach)
    shapes = [shapely.linestrings(line) for line in lines if len(line) > 1]
    return sum(shape.intersection(around).length < shape.length / 2 for shape in shapes)


def _rings(region: MultiPolygon) -> list[FloatArray]:
    """(N, 2) each, without the repeated last point."""
    rings = [ring for polygon in region.geoms for ring in (polygon.exterior, *polygon.interiors)]
    return [shapely.get_coordinates(ring)[:-1] for ring in rings]
