"""Heights and widths of a room with their σ, from the joint covariance of its planes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Literal

import numpy as np
import shapely

from gtlayout.geometry.rays import depth_on_plane
from gtlayout.instances import Dimension, Extent, Instance, Plane, PlaneFrame, propagated_sigma
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


def room_dimensions(
    instances: Sequence[Instance], planes: Sequence[Plane], extents: Sequence[Extent], covariance: FloatArray
) -> tuple[Dimension, ...]:
    """Every distance from a floor to a ceiling and from a wall to a wall that face each other; observable planes only.

    Two instances face each other when their normals are opposite within ``MAX_ANGLE_DEG``, each lies in front of the
    other, and their extents overlap in the direction that bisects them. The distance is taken in that direction,
    through the overlap's centroid: for parallel planes it is the distance, for others the mean of the distances of each
    end from the other plane, divided by the cosine of half their angle.

    Args:
        covariance: (4S, 4S) joint covariance of all planes in the world, about their anchor.
    """
    found = []
    for i, j in combinations(range(len(instances)), 2):
        labels = frozenset({instances[i].label, instances[j].label})
        if labels not in _KINDS or not (planes[i].observable and planes[j].observable):
            continue
        a, b = (j, i) if instances[j].label == "floor" else (i, j)
        if planes[a].normal @ planes[b].normal > -np.cos(np.deg2rad(MAX_ANGLE_DEG)):
            continue
        across = planes[a].normal - planes[b].normal
        across /= np.linalg.norm(across)
        middle = _middle_of_overlap(extents[a], extents[b], across)
        if middle is None:
            continue
        ends, gradients = zip(*(_hit(planes[k], middle, across) for k in (a, b)), strict=True)
        length = float((ends[1] - ends[0]) @ across)
        if length > 0:
            sigma = _sigma(covariance, (a, b), (-gradients[0], gradients[1]))
            found.append(Dimension(a, b, _KINDS[labels], length, sigma, np.stack(ends)))
    return tuple(found)


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


def _sigma(covariance: FloatArray, surfaces: tuple[int, int], gradients: tuple[FloatArray, FloatArray]) -> float:
    """σ of t_second − t_first, cross terms included."""
    rows = np.concatenate([np.arange(4 * s, 4 * s + 4) for s in surfaces])
    gradient = np.concatenate(gradients)
    return float(propagated_sigma(gradient, covariance[np.ix_(rows, rows)]))
