"""Elements with errors: shifted, jittered, mislabelled, left out, of another time.

Which element and which frame is chosen by rule, not at random: the middle key frame and what is largest there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.io.annotations.outlines import polygonal
from gtlayout.scene import Camera, Element, FloatArray, KeyFrame

BESIDE_PX = 3.0
"""Vertices of neighbours this near to an edge belong to the same edge of the room."""
BORDER_PX = 2.0
"""What runs this near along the image border is no edge of the room."""
Drawn = list[tuple[int, Element]]
"""Elements of one key frame, each with its number in the original."""


def drawn(key_frame: KeyFrame) -> Drawn:
    """All of them."""
    return list(enumerate(key_frame.elements))


def shifted_element(elements: Drawn, number: int, shift_px: FloatArray, camera: Camera) -> Drawn:
    """One element moved within the image, visible parts and all; off the image it is left out."""

    def move(region: MultiPolygon) -> MultiPolygon:
        return clipped(shapely.transform(region, lambda points: points + shift_px), camera)

    return _changed(elements, number, lambda e: replace(e, amodal=move(e.amodal), visible=move(e.visible)))


def shifted_edge(elements: Drawn, edge_px: FloatArray, shift_px: float, camera: Camera) -> Drawn:
    """A straight edge, (2, 2) px, moved sideways in all elements that have vertices on it.

    Visible parts end where their elements do now.
    """
    along = edge_px[1] - edge_px[0]
    sideways = np.array([-along[1], along[0]]) / np.linalg.norm(along) * shift_px
    line = shapely.LineString(edge_px)

    def move(points: FloatArray) -> FloatArray:
        on_edge = shapely.distance(shapely.points(points), line) <= BESIDE_PX
        return np.asarray(points + on_edge[:, None] * sideways)

    def change(element: Element) -> Element:
        amodal = clipped(shapely.transform(element.amodal, move), camera)
        return replace(element, amodal=amodal, visible=polygonal(element.visible & amodal))

    return [(e, changed) for e, element in elements if not (changed := change(element)).amodal.is_empty]


def longest_edge(element: Element, camera: Camera) -> FloatArray | None:
    """(2, 2) px: the longest straight edge that does not run along the image border; None when there is none."""
    border = shapely.box(0, 0, camera.width, camera.height).exterior
    edges: list[tuple[FloatArray, FloatArray]] = []
    for polygon in element.amodal.geoms:
        points = shapely.get_coordinates(polygon.exterior)
        edges += pairwise(points)
    inner = [
        np.array(pair) for pair in edges if shapely.distance(shapely.Point((pair[0] + pair[1]) / 2), border) > BORDER_PX
    ]
    return max(inner, key=lambda edge: float(np.linalg.norm(edge[1] - edge[0])), default=None)


def jittered(elements: Drawn, sigma_px: float, camera: Camera, rng: np.random.Generator) -> Drawn:
    """Every vertex off by a Gaussian error along x and y; neighbours each by their own."""

    def move(region: MultiPolygon) -> MultiPolygon:
        return clipped(with_rings(region, lambda ring: ring + rng.normal(0, sigma_px, ring.shape)), camera)

    moved = [(e, replace(of, amodal=move(of.amodal), visible=move(of.visible))) for e, of in elements]
    return [(e, element) for e, element in moved if not element.amodal.is_empty]


def swapped_labels(elements: Drawn, first: int, second: int) -> Drawn:
    """Two elements with each other's label."""
    labels = {first: elements[second][1].label, second: elements[first][1].label}
    return [(e, replace(element, label=labels.get(e, element.label))) for e, element in elements]


def visible_on_furniture(elements: Drawn) -> Drawn:
    """Visible parts where each element is hidden; as they were where nothing hides it."""
    hidden = [(e, element, polygonal(element.amodal - element.visible)) for e, element in elements]
    return [(e, element if part.is_empty else replace(element, visible=part)) for e, element, part in hidden]


def largest(elements: Sequence[tuple[int, Element]], labels: Sequence[str] = ()) -> int:
    """Number of the largest element of these labels, of all when there is none of them."""
    among = [pair for pair in elements if pair[1].label in labels] or list(elements)
    return max(among, key=lambda pair: pair[1].amodal.area)[0]


def largest_of_another_label(elements: Drawn, number: int) -> int | None:
    """Number of the largest element that has not the label of that one; None when all have it."""
    others = [pair for pair in elements if pair[1].label != elements[number][1].label]
    return largest(others) if others else None


def with_rings(region: MultiPolygon, move: Callable[[FloatArray], FloatArray]) -> MultiPolygon:
    """The region with each (N, 2) ring moved, given without its repeated last point; it may be invalid then."""
    polygons = []
    for polygon in region.geoms:
        outer, *holes = (move(shapely.get_coordinates(ring)[:-1]) for ring in (polygon.exterior, *polygon.interiors))
        polygons.append(Polygon(outer, holes))
    return MultiPolygon(polygons)


def clipped(region: MultiPolygon, camera: Camera) -> MultiPolygon:
    """What of it is valid and within the image."""
    valid = shapely.make_valid(region, method="structure", keep_collapsed=False)
    return polygonal(valid & shapely.box(0, 0, camera.width, camera.height))


def _changed(elements: Drawn, number: int, change: Callable[[Element], Element]) -> Drawn:
    changed = [(e, change(element) if e == number else element) for e, element in elements]
    return [(e, element) for e, element in changed if not element.amodal.is_empty]
