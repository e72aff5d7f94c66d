"""Closed polyhedra between two outlines, one behind the other. Plain geometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shapely import Polygon

from gtlayout.scene import FloatArray

Corner = tuple[FloatArray, Sequence[FloatArray]]
"""A point (2,) of the front, and one or two (2,) of the back: two where the back has a step."""
_SAME = 1e-7
"""World unit: points closer than this are one, and lie in one plane."""

_QUAD = 4


@dataclass(frozen=True)
class Solid:
    """A closed polyhedron."""

    points: FloatArray
    """(N, 3)."""
    faces: tuple[tuple[tuple[int, ...], ...], ...]
    """Of each face its outer ring, counter-clockwise seen from outside, and its holes, clockwise; indices of points."""


def between(rings: Sequence[Sequence[Corner]], front: FloatArray, back: FloatArray) -> Solid:
    """The solid from a front to a back behind it.

    Args:
        rings: the outer ring, counter-clockwise, then the holes, clockwise.
        front, back: (3,) coefficients (a, b, c) of the planes z = a x + b y + c in which they lie.
    """
    points: list[FloatArray] = []
    tops_of, feet_of, sides = [], [], []
    for ring in rings:
        tops = [_add(points, _raised(point, front)) for point, _ in ring]
        own = len(points)
        # Of each corner where the side before it ends and where the side after it begins.
        feet = [[_once(points, own, _raised(point, back)) for point in behind] for _, behind in ring]
        for k, (before, after) in enumerate(zip([*feet[-1:], *feet[:-1]], feet, strict=True)):
            sides += [(tops[k], after[0], after[-1]), (tops[k], tops[k - 1], before[-1], after[0])]
        tops_of.append(tuple(tops))
        feet_of.append(tuple(reversed(dict.fromkeys(foot for both in feet for foot in both))))
    at = np.array(points)
    return Solid(at, (tuple(tops_of), tuple(feet_of), *((flat,) for side in sides for flat in _flat(at, side))))


def crosses_itself(rings: Sequence[Sequence[Corner]]) -> bool:
    """Whether the back, or what is half way to it, is no polygon with holes."""
    backs = [np.array([q for _, behind in ring for q in behind]) for ring in rings]
    halves = [np.array([(p + q) / 2 for p, behind in ring for q in behind]) for ring in rings]
    return not (_is_polygon(backs) and _is_polygon(halves))


def _raised(point: FloatArray, plane: FloatArray) -> FloatArray:
    return np.array([*point, plane[:2] @ point + plane[2]])


def _add(points: list[FloatArray], point: FloatArray) -> int:
    points.append(point)
    return len(points) - 1


def _once(points: list[FloatArray], own: int, point: FloatArray) -> int:
    """The index of a foot. Two corners that follow each other may have one: the edge between them has no length."""
    for i in (own, len(points) - 1):
        if own <= i < len(points) and np.abs(points[i] - point).max() <= _SAME:
            return i
    return _add(points, point)


def _flat(points: FloatArray, side: tuple[int, ...]) -> list[tuple[int, ...]]:
    """A side as it is, or as two triangles when its four points are not in one plane; none without area."""
    ring = tuple(dict.fromkeys(side))
    if len(ring) < _QUAD:
        return [ring] if len(ring) == _QUAD - 1 else []
    a, b, c, d = points[list(ring)]
    normal = np.cross(b - a, c - a)
    if abs(normal @ (d - a)) <= _SAME * np.linalg.norm(normal):
        return [ring]
    return [ring[:3], (ring[0], *ring[2:])]


def _is_polygon(rings: Sequence[FloatArray]) -> bool:
    """Whether rings bound an area: none crosses another or itself, and each turns the way it should."""
    outer, *holes = (Polygon(ring) for ring in rings)
    whole = Polygon(outer.exterior, [hole.exterior for hole in holes])
    return bool(whole.is_valid and outer.exterior.is_ccw and not any(hole.exterior.is_ccw for hole in holes))
