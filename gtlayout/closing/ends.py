"""Where walls go on to beyond what is seen of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.closing.walls import End, Wall, passes
from gtlayout.closing_config import ClosingConfig
from gtlayout.scene import FloatArray


def with_ends(
    walls: Mapping[int, Wall], free: BaseGeometry, eyes: Sequence[FloatArray], same: float, config: ClosingConfig
) -> dict[int, Wall]:
    """The walls with what they go on to.

    A wall goes on to the first other one in its way that turns towards the room there: to a corner. That one must be
    seen where they meet, or must itself go on to there. Without a corner, a wall that is square to another goes on to
    abreast of the cameras, unless another may stand between. No wall passes through what is known to be ``free``.

    Args:
        walls: At one height, by instance.
        free: In plan, smaller than it is by ``same`` all around.
        eyes: (2,) each, the cameras in plan.
        same: Nearer than this is the same place.
        config: See there.
    """
    best = {
        (i, side): found
        for i in walls
        for side in (0, 1)
        if (found := _next_corner(i, side, walls, free, same, config)) is not None
    }
    made = {}
    for i, wall in walls.items():
        ends = []
        for side in (0, 1):
            other = best.get((i, side))
            if other is not None and (
                walls[other].is_seen(wall.corner(walls[other]), same) or best.get((other, 1 - side)) == i
            ):
                ends.append(End(corner=other))
            else:
                ends.append(End(eye=_abreast(i, side, walls, free, eyes, same, config)))
        made[i] = replace(wall, ends=(ends[0], ends[1]))
    return made


def _next_corner(
    i: int, side: int, walls: Mapping[int, Wall], free: BaseGeometry, same: float, config: ClosingConfig
) -> int | None:
    """The wall that wall ``i`` may meet first beyond its left (0) or right (1) end."""
    wall, sign = walls[i], (-1.0, 1.0)[side]
    found: list[tuple[float, int | None]] = []
    for j, other in walls.items():
        if j == i or _is_parallel(wall, other, config):
            continue
        corner = wall.corner(other)
        beyond = sign * (float(corner @ wall.along) - wall.end(side))
        if beyond < -same:
            continue
        seen = other.is_seen(corner, same)
        # In a corner that turns towards the room each lies before the other, and the right end meets a left one.
        towards = other.value(wall.middle) > 0 and (seen or wall.value(other.nearest(corner)) > -same)
        if seen and not towards and beyond > same:
            found.append((beyond, None))  # It stands in the way with its back.
        elif towards and (seen or -sign * (float(corner @ other.along) - other.end(1 - side)) >= -same):
            found.append((beyond, j))
    for _, next_one in sorted(found, key=lambda one: (one[0], -1 if one[1] is None else one[1])):
        if next_one is None:
            return None
        other = walls[next_one]
        corner = wall.corner(other)
        hidden = other.is_seen(corner, same) or not passes(other.at(other.end(1 - side)), corner, free, same)
        if hidden and not passes(wall.at(wall.end(side)), corner, free, same):
            return next_one
    return None


def _abreast(
    i: int,
    side: int,
    walls: Mapping[int, Wall],
    free: BaseGeometry,
    eyes: Sequence[FloatArray],
    same: float,
    config: ClosingConfig,
) -> FloatArray | None:
    """The farthest camera in a wall's direction, if the wall goes on to abreast of it."""
    wall, sign = walls[i], (-1.0, 1.0)[side]
    others = [other for j, other in walls.items() if j != i]
    square = np.sin(np.deg2rad(config.max_off_square_deg))
    eye = max(eyes, key=lambda eye: sign * float(eye @ wall.along))
    start, end = wall.at(wall.end(side)), wall.at(float(eye @ wall.along))
    length = sign * float((end - start) @ wall.along)
    if (
        length <= same
        or wall.value(eye) <= same
        or not any(abs(wall.line[:2] @ other.line[:2]) < square for other in others)
        or passes(start, end, free, same)
    ):
        return None
    between = Polygon([start, end, eye])
    for other in others:
        if any(LineString([other.at(a), other.at(b)]).intersects(between) for a, b in other.spans):
            return None
        if not _is_parallel(wall, other, config):
            corner = wall.corner(other)
            on_the_way = same < sign * float((corner - start) @ wall.along) < length
            hidden = shapely.difference(LineString([other.nearest(corner), corner]), free).length
            if on_the_way and hidden > config.max_hidden_share * wall.value(eye):
                return None
    return eye


def _is_parallel(wall: Wall, other: Wall, config: ClosingConfig) -> bool:
    return bool(abs(wall.line[:2] @ other.line[:2]) > np.cos(np.deg2rad(config.min_corner_deg)))
