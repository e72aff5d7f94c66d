"""Walls in plan: how far each is seen, and which of them meet in a corner that nobody saw."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.closing.plan import Plan, crossing
from gtlayout.instances import Plane
from gtlayout.scene import FloatArray

Spans = tuple[tuple[float, float], ...]
"""Stretches along a wall, from left to right seen from the room."""


@dataclass(frozen=True)
class Wall:
    """A wall in plan, at one height."""

    line: FloatArray
    """(3,) a u + b v + c = 0, positive in the room, (a, b) of unit length."""
    along: FloatArray
    """(2,) unit vector, to the right seen from the room."""
    spans: Spans
    """Where it is seen, at any height: ``along`` · (u, v)."""
    corners: tuple[int | None, int | None] = (None, None)
    """The wall that its first span is continued to, and the same of its last."""
    abreast: tuple[FloatArray | None, FloatArray | None] = (None, None)
    """(2,) the camera abreast of which its first span is continued without a corner, and the same of its last."""

    def at(self, along: float) -> FloatArray:
        """(2,) the point of it there."""
        return along * self.along - self.line[2] * self.line[:2]

    def value(self, points: FloatArray) -> FloatArray:
        """(...) distance of (..., 2) points before it."""
        return points @ self.line[:2] + self.line[2]


def wall_of(
    plan: Plan, plane: Plane, surface: Plane, spans: Spans, corners: tuple[int | None, int | None] = (None, None), abreast=(None,None)
) -> Wall:
    """A wall where it meets a surface. ``spans`` are along its own level direction, whatever the surface."""
    trace = plan.trace(plane, surface)
    line = trace / np.linalg.norm(trace[:2])
    return Wall(line, np.array([-line[1], line[0]]), spans, corners, abreast)


def spans_of(wall: Wall, rings: Iterable[FloatArray], gap: float) -> Spans:
    """The stretches along a wall that what is seen of it, rings of (N, 2) in plan, covers; gaps up to ``gap`` are closed."""
    found: list[tuple[float, float]] = []
    for ring in rings:
        along = ring @ wall.along
        found.append((float(along.min()), float(along.max())))
    merged: list[tuple[float, float]] = []
    for start, end in sorted(found):
        if merged and start <= merged[-1][1] + gap:
            merged[-1] = merged[-1][0], max(merged[-1][1], end)
        else:
            merged.append((start, end))
    return tuple(merged)


def with_corners(
    walls: Mapping[int, Wall], free: BaseGeometry, eyes, same: float, min_corner_deg: float
) -> dict[int, Wall]:
    """The walls with the corners in which they meet although nobody saw it.

    A wall goes on to the first other one in its way that turns towards the room there. That one must be seen where they
    meet, or must itself go on to there. Neither passes through what is known to be ``free``, which is smaller than it
    is by ``same`` all around.
    """
    best: dict[tuple[int, int], tuple[int, float]] = {}
    for i, wall in walls.items():
        for side in (0, 1):
            found = _next_corner(i, side, walls, free, same, min_corner_deg)
            if found is not None:
                best[i, side] = found
    made = {i: [None, None] for i in walls}
    for (i, side), (j, _) in best.items():
        seen = _is_seen(walls[j], _corner(walls[i], walls[j]), same)
        if seen or best.get((j, 1 - side), (None,))[0] == i:
            made[i][side] = j  # type: ignore[call-overload]
    found = {i: replace(wall, corners=(made[i][0], made[i][1])) for i, wall in walls.items()}
    return {i: replace(wall, abreast=tuple(_abreast(i, side, found, free, eyes, same) for side in (0, 1))) for i, wall in found.items()}


def _abreast(i, side, walls, free, eyes, same):
    wall, sign = walls[i], (-1.0, 1.0)[side]
    if wall.corners[side] is not None:
        return None
    square = np.sin(np.deg2rad(3.0))
    if not any(abs(wall.line[:2] @ other.line[:2]) < square for j, other in walls.items()):
        return None
    end = wall.spans[-side][side]
    eye = max(eyes, key=lambda eye: sign * float(eye @ wall.along))
    to = float(eye @ wall.along)
    if sign * (to - end) <= same or wall.value(eye) <= 0:
        return None
    way = LineString([wall.at(end), wall.at(to)])
    if way.intersection(free).length > same:
        return None
    for j, other in walls.items():
        if j != i:
            for a, b in other.spans:
                if LineString([other.at(a), other.at(b)]).intersects(Polygon([wall.at(end), wall.at(to), eye])):
                    return None
    return eye


def segments(walls: Mapping[int, Wall], free: BaseGeometry, same: float) -> dict[int, list[LineString]]:
    """Where each wall stands in plan: seen, continued to corners, and between stretches where nothing shows a passage."""
    found = {}
    for i, wall in walls.items():
        ends = [[wall.at(start), wall.at(end)] for start, end in wall.spans]
        for side, j in enumerate(wall.corners):
            if j is not None:
                ends[-side][side] = _corner(wall, walls[j])
            elif wall.abreast[side] is not None:
                ends[-side][side] = wall.at(float(wall.abreast[side] @ wall.along))
        joined = ends[:1]
        for start, end in ends[1:]:
            if shapely.intersection(LineString([joined[-1][1], start]), free).length <= same:
                joined[-1][1] = end
            else:
                joined.append([start, end])
        found[i] = [LineString(both) for both in joined]
    return found


def _corner(first: Wall, second: Wall) -> FloatArray:
    return crossing(first.line, second.line)


def _next_corner(
    i: int, side: int, walls: Mapping[int, Wall], free: BaseGeometry, same: float, min_corner_deg: float
) -> tuple[int, float] | None:
    """The wall that wall ``i`` meets first beyond its left (0) or right (1) end, and how far from there."""
    wall, sign = walls[i], (-1.0, 1.0)[side]
    end = wall.spans[-side][side]
    middle = wall.at((wall.spans[-side][0] + wall.spans[-side][1]) / 2)
    found: list[tuple[float, int]] = []
    for j, other in walls.items():
        turn = float(wall.line[:2] @ other.line[:2])
        if j == i or abs(turn) > np.cos(np.deg2rad(min_corner_deg)):
            continue
        point = _corner(wall, other)
        beyond = sign * (float(point @ wall.along) - end)
        if beyond < -same:
            continue
        # The other's right end continues a wall's left one.
        ahead = (-sign) * (float(point @ other.along) - other.spans[side - 1][1 - side])
        seen = _is_seen(other, point, same)
        near = other.at(float(np.clip(point @ other.along, other.spans[0][0], other.spans[-1][1])))
        towards = other.value(middle) > 0 and (seen or wall.value(near) > -same)
        if seen and not towards and beyond > same:
            found.append((beyond, -1))  # It stands in the way with its back.
        elif towards and (seen or ahead >= -same):
            found.append((beyond, j))
    for beyond, j in sorted(found):
        if j < 0:
            return None
        way = LineString([wall.at(end), _corner(wall, walls[j])])
        back = LineString([walls[j].at(walls[j].spans[side - 1][1 - side]), _corner(wall, walls[j])])
        hidden = _is_seen(walls[j], _corner(wall, walls[j]), same) or back.intersection(free).length <= same
        if way.intersection(free).length <= same and hidden:
            return j, beyond
    return None


def _is_seen(wall: Wall, point: FloatArray, same: float) -> bool:
    along = float(point @ wall.along)
    return any(start - same <= along <= end + same for start, end in wall.spans)
