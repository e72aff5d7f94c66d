"""Polygons after GEOS: only what is polygonal, on a grid, cut along a line."""

from __future__ import annotations

from typing import Literal

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.scene import FloatArray

_GRID_SHARE = 1e-9
"""Step of the grid as a share of the size of what lies on it."""
_MOST_VERTICES = 256
"""Lines with more are buffered in runs …"""
_RUN = 32
"""… of so many: GEOS crosses the arcs round all vertices that lie within the distance of each other."""
_BOX = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def polygons(geometry: BaseGeometry) -> MultiPolygon:
    """The polygonal part of any geometry, made valid; points and lines are dropped."""
    valid = shapely.make_valid(geometry)
    return MultiPolygon(
        [part for part in shapely.get_parts(flat(valid)) if isinstance(part, Polygon) and part.area > 0]
    )


def grid_for(size: float) -> float:
    """The step of the grid on which geometry of this size lies: a power of two, so that its coordinates are exact.

    Coordinates that differ only by rounding, and so between kinds of processors, are equal on it: no decision depends
    on the last bit. 0, no grid, for a size that is not finite.
    """
    return float(np.exp2(np.floor(np.log2(_GRID_SHARE * size)))) if np.isfinite(size) else 0.0


def flat(geometry: BaseGeometry) -> BaseGeometry:
    """A collection without nested collections."""
    parts = shapely.get_parts(shapely.get_parts(geometry))
    return shapely.geometrycollections(parts)


def buffered(
    lines: BaseGeometry,
    distance: float,
    cap_style: Literal["round", "square", "flat"] = "round",
    arc_segments: int = 16,
) -> BaseGeometry:
    """What lies within ``distance`` of some lines, at a cost that grows no faster than n log n with their vertices.

    ``arc_segments`` lines are a quarter of a circle.
    """
    parts = shapely.get_parts(lines)
    if shapely.get_num_coordinates(lines) > _MOST_VERTICES:
        # Runs of a line share an edge: within it there are joins, and no caps.
        runs = [
            points[start : start + _RUN + 2]
            for points in map(shapely.get_coordinates, parts)
            for start in range(0, len(points) - 1, _RUN)
        ]
        parts = np.array([LineString(run) for run in runs])
    # GEOS takes six times as long for many at once, and loses slivers at flat ends.
    around = shapely.buffer(parts, distance, cap_style=cap_style, quad_segs=arc_segments)
    return around[0] if len(around) == 1 else shapely.union_all(around)


def homogeneous(points: FloatArray) -> FloatArray:
    """(N, 2) → (N, 3), with ones."""
    return np.column_stack([points, np.ones(len(points))])


def cut(region: BaseGeometry, coefficients: FloatArray) -> BaseGeometry:
    """The part of a region with a x + b y + c >= 0. Most lie on one side as a whole, which costs no overlay.

    Empty where the coefficients are not finite: see ``half_plane``.
    """
    if not np.isfinite(coefficients).all():
        return Polygon()
    value = homogeneous(shapely.get_coordinates(region)) @ coefficients
    if (value >= 0).all():
        return region
    return Polygon() if (value < 0).all() else region.intersection(half_plane(coefficients, region))


def half_plane(coefficients: FloatArray, around: BaseGeometry) -> Polygon:
    """The part with a x + b y + c >= 0, as a polygon large enough for ``around``.

    Empty where they are not finite, as of a plane that the camera lies on: it is seen edge on, and shows nothing.
    """
    if not np.isfinite(coefficients).all():
        return Polygon()
    low, high = np.reshape(around.bounds, (2, 2))
    corners = (low + high) / 2 + _BOX * (high - low).max()
    value = homogeneous(corners) @ coefficients
    ring = []
    for k in range(4):
        if value[k] >= 0:
            ring.append(corners[k])
        if (value[k] >= 0) != (value[(k + 1) % 4] >= 0):
            share = value[k] / (value[k] - value[(k + 1) % 4])
            ring.append(corners[k] + share * (corners[(k + 1) % 4] - corners[k]))
    return Polygon(ring) if len(ring) >= 3 else Polygon()
