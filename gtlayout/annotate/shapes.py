"""What the page asks of shapes: to paint with a brush, and to cut along a line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon
from shapely.ops import split

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.polygons import polygons
from gtlayout.io.annotations.masks import simple_rings
from gtlayout.scene import FloatArray

TIDY_PX = 0.3
"""How far an outline that a brush left may move when vertices go that say nothing."""
SMALLEST_PX2 = 4.0
"""Smaller pieces are left-overs."""
DECIMALS = 2
"""Of a pixel, as drawn."""


def region_of(rings: Sequence[Sequence[Sequence[float]]]) -> MultiPolygon:
    """The union of outlines, each a list of at least three pairs, px."""
    return polygons(shapely.union_all([polygons(Polygon(ring)) for ring in rings]))


def rings_px(region: MultiPolygon) -> list[list[list[float]]]:
    """(x, y) of the outlines that make up a region, as JSON has them: none crosses itself, also when it is rounded.

    Their corners have the order of the region's, unless rounding would make an outline cross itself.
    """
    rings = [ring.round(DECIMALS) for ring in simple_rings(region)]
    if not all(Polygon(ring).is_valid for ring in rings):
        on_grid = polygons(shapely.set_precision(region, 10.0**-DECIMALS))
        rings = [ring.round(DECIMALS) for ring in simple_rings(on_grid)]
    return [ring.tolist() for ring in rings]


def painted(
    region: MultiPolygon, stroke_px: FloatArray, radius_px: float, within: MultiPolygon, *, erase: bool
) -> MultiPolygon:
    """A region after a stroke, (N, 2) px, of a round brush; nothing is painted outside of ``within``."""
    line = LineString(stroke_px) if len(stroke_px) > 1 else shapely.Point(stroke_px[0])
    mark = line.buffer(radius_px, quad_segs=4)
    changed = region.difference(mark) if erase else region.union(mark.intersection(within))
    return tidy(polygons(changed.simplify(TIDY_PX)))


def tidy(region: MultiPolygon) -> MultiPolygon:
    """Without left-overs."""
    return MultiPolygon([part for part in region.geoms if part.area >= SMALLEST_PX2])


def halves(region: MultiPolygon, line_px: FloatArray) -> tuple[MultiPolygon, MultiPolygon]:
    """The parts on either side of the straight line through (2, 2) px, the larger first.

    Raises GtlayoutError when it has one side only.
    """
    start, end = line_px
    along = end - start
    length = float(np.linalg.norm(along))
    if length == 0:
        raise GtlayoutError("a line to split along needs two points")
    far = along / length * 1e5
    parts = split(region, LineString([start - far, end + far])).geoms
    across = np.array([-along[1], along[0]])
    sides: tuple[list[Polygon], list[Polygon]] = ([], [])
    for part in parts:
        point = part.representative_point()
        sides[int((np.array([point.x, point.y]) - start) @ across > 0)].append(part)
    first, second = (tidy(polygons(shapely.union_all(side))) for side in sides)
    if first.is_empty or second.is_empty:
        raise GtlayoutError("the line does not cut the element in two")
    return (first, second) if first.area >= second.area else (second, first)
