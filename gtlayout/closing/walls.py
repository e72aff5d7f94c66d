"""Walls in plan: how far each is seen, and how far it goes on where nobody looked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from gtlayout.closing.plan import Plan, crossing
from gtlayout.instances import Plane
from gtlayout.scene import FloatArray

Spans = tuple[tuple[float, float], ...]
"""Stretches along a wall, from left to right seen from the room."""


@dataclass(frozen=True)
class End:
    """Where a wall goes on to beyond what is seen of it: to a corner with another wall, or abreast of a camera."""

    corner: int | None = None
    """The instance that it meets there."""
    eye: FloatArray | None = None
    """(2,) the camera in plan."""


@dataclass(frozen=True)
class Wall:
    """A wall in plan, at one height."""

    line: FloatArray
    """(3,) a u + b v + c = 0, positive in the room, (a, b) of unit length."""
    spans: Spans
    """Where it is seen, at any height: ``along`` · (u, v)."""
    ends: tuple[End, End] = (End(), End())
    """How its first span goes on to the left, and its last to the right."""

    @property
    def along(self) -> FloatArray:
        """(2,) unit vector, to the right seen from the room."""
        return np.array([-self.line[1], self.line[0]])

    def at(self, along: float) -> FloatArray:
        """(2,) the point of it there."""
        return along * self.along - self.line[2] * self.line[:2]

    def end(self, side: int) -> float:
        """How far it is seen to the left (0) or right (1), along it."""
        return self.spans[-side][side]

    @property
    def middle(self) -> FloatArray:
        """(2,) between its ends."""
        return self.at((self.end(0) + self.end(1)) / 2)

    def value(self, point: FloatArray) -> float:
        """Distance of a (2,) point before it."""
        return float(point @ self.line[:2] + self.line[2])

    def nearest(self, point: FloatArray) -> FloatArray:
        """(2,) the point between its ends that is nearest to a (2,) one."""
        return self.at(float(np.clip(point @ self.along, self.end(0), self.end(1))))

    def is_seen(self, point: FloatArray, same: float) -> bool:
        """Whether it is seen at a (2,) point on it."""
        along = float(point @ self.along)
        return any(start - same <= along <= end + same for start, end in self.spans)

    def corner(self, other: Wall) -> FloatArray:
        """(2,) where it meets another; far away for parallel ones."""
        return crossing(self.line, other.line)


def wall_of(
    plan: Plan, plane: Plane, surface: Plane, spans: Spans = (), ends: tuple[End, End] = (End(), End())
) -> Wall:
    """A wall where it meets a surface."""
    trace = plan.trace(plane, surface)
    return Wall(trace / np.linalg.norm(trace[:2]), spans, ends)


def spans_of(wall: Wall, rings: Iterable[FloatArray], gap: float) -> Spans:
    """The stretches along a wall that (N, 2) rings in plan cover; gaps up to ``gap`` are closed."""
    merged: list[tuple[float, float]] = []
    for start, end in sorted(
        (float(along.min()), float(along.max())) for along in (ring @ wall.along for ring in rings)
    ):
        if merged and start <= merged[-1][1] + gap:
            merged[-1] = merged[-1][0], max(merged[-1][1], end)
        else:
            merged.append((start, end))
    return tuple(merged)


def stands(walls: Mapping[int, Wall], free: BaseGeometry, same: float) -> dict[int, list[LineString]]:
    """Where each wall stands in plan: seen, gone on, and between its spans where nothing shows a passage."""
    found = {}
    for i, wall in walls.items():
        pieces = [[wall.at(start), wall.at(end)] for start, end in wall.spans]
        for side, beyond in enumerate(wall.ends):
            if beyond.corner is not None:
                pieces[-side][side] = wall.corner(walls[beyond.corner])
            elif beyond.eye is not None:
                pieces[-side][side] = wall.at(float(beyond.eye @ wall.along))
        joined = pieces[:1]
        for start, end in pieces[1:]:
            if passes(joined[-1][1], start, free, same):
                joined.append([start, end])
            else:
                joined[-1][1] = end
        found[i] = [LineString(both) for both in joined if not np.array_equal(both[0], both[1])]
    return found


def passes(start: FloatArray, end: FloatArray, free: BaseGeometry, same: float) -> bool:
    """Whether the way between two (2,) points passes through what is known to be free."""
    return bool(shapely.intersection(LineString([start, end]), free).length > same)
