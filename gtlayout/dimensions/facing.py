"""Distances between surfaces that face each other: heights and widths of a room."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Literal

import numpy as np
import shapely

from gtlayout.dimensions.measurable import Measurable
from gtlayout.geometry.rays import depth_on_plane
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import Dimension, Extent, Instance, Plane, PlaneFrame
from gtlayout.scene import FloatArray, Label

MAX_ANGLE_DEG = 10.0
"""Planes further than this from parallel have no distance. The same angle from which on two planes have an intersection
line (``ExtentConfig.min_angle_deg``); up to it the distance differs from that of either plane's foot by .4 %."""
MIN_OVERLAP = 0.1
"""Share of the smaller extent that must lie opposite the other: extents are only known to 10 % (paper 3.4)."""
_KINDS: dict[frozenset[Label], Literal["height", "width"]] = {
    frozenset({"floor", "ceiling"}): "height",
    frozenset({"wall"}): "width",
}
Taken = tuple[Dimension, Measurable]
"""A dimension, its σ not yet known, and what that follows from."""


def distances(instances: Sequence[Instance], planes: Sequence[Plane], extents: Sequence[Extent]) -> list[Taken]:
    """Every distance from a floor to a ceiling and from a wall to a wall that face each other; observable planes only.

    Two instances face each other when their normals are opposite within ``MAX_ANGLE_DEG``, each lies in front of the
    other, and their extents overlap in the direction that bisects them. The distance is taken in that direction,
    through the overlap's centroid: for parallel planes it is the distance, for others the mean of the distances of each
    end from the other plane, divided by the cosine of half their angle.
    """
    found = []
    for i, j in combinations(range(len(instances)), 2):
        kind = _KINDS.get(frozenset({instances[i].label, instances[j].label}))
        a, b = (j, i) if instances[j].label == "floor" else (i, j)
        if kind and (taken := distance_between(planes, extents, a, b, kind)):
            found.append(taken)
    return found


def distance_between(
    planes: Sequence[Plane], extents: Sequence[Extent], a: int, b: int, kind: Literal["height", "width"]
) -> Taken | None:
    """The distance of two instances, as in ``distances``; None when they do not face each other, or are curved."""
    if not (planes[a].observable and planes[b].observable):
        return None
    if strip_of(extents[a]) or strip_of(extents[b]):
        return None
    if planes[a].normal @ planes[b].normal > -np.cos(np.deg2rad(MAX_ANGLE_DEG)):
        return None
    across = planes[a].normal - planes[b].normal
    across /= np.linalg.norm(across)
    middle = _middle_of_overlap(extents[a], extents[b], across)
    if middle is None:
        return None
    ends, gradients = zip(*(_hit(planes[k], middle, across) for k in (a, b)), strict=True)
    length = float((ends[1] - ends[0]) @ across)
    if length <= 0:
        return None
    gradient = np.zeros(4 * len(planes))
    gradient[4 * a : 4 * a + 4], gradient[4 * b : 4 * b + 4] = -gradients[0], gradients[1]
    return Dimension(a, b, kind, length, np.nan, np.stack(ends)), Measurable(length, gradient)


def _middle_of_overlap(first: Extent, second: Extent, across: FloatArray) -> FloatArray | None:
    """(3,) a point over the centroid of what two extents cover alike, seen along ``across``; None when that is little.

    The regions are projected orthogonally on a plane at right angles to ``across``.
    """
    frame = PlaneFrame.across(across, first.frame.origin)
    # Projected at an angle a polygon may touch itself.
    one, other = (frame.region(e.frame.rings_to_world(e.region)).buffer(0) for e in (first, second))
    overlap = one.intersection(other)
    if overlap.is_empty or overlap.area < MIN_OVERLAP * min(one.area, other.area):
        return None
    middle: FloatArray = frame.to_world(shapely.get_coordinates(overlap.centroid))[0]
    return middle


def _hit(plane: Plane, point: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where a line ``point + t across`` hits a plane: (3,) the hit, and (4,) dt / d(normal, normal · anchor + d) =
    −(hit − anchor, 1) / n·across.

    ``across`` counts as fixed. The length between two planes does not depend on it to first order: between planes that
    it bisects it is the shortest way through its own middle.
    """
    facing = float(plane.normal @ across)
    hit = point + depth_on_plane(plane.normal @ point + plane.d, np.array(facing)) * across
    return hit, -np.append(hit - plane.anchor, 1.0) / facing
