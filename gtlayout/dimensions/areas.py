"""Areas of floors and walls, and the volume over floors, with what they change by when planes move."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from gtlayout.dimensions.facing import Taken
from gtlayout.dimensions.measurable import Measurable
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.geometry.polygons import polygons
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import Quantity, QuantityKind
from gtlayout.scene import FloatArray, Label

_CLOSED_SHARE = 0.95
"""A region is closed when so much of its outline lies on other surfaces; the rest is where nobody looked."""
_STRAIGHT_SHARE = 1e-3
"""Corners that lie off the line between their neighbours by less than this share of the room's size are none."""


def quantities(
    room: SolvedRoom, heights: Sequence[Taken], astray: Collection[int] = ()
) -> list[tuple[Quantity, Measurable]]:
    """The area of every floor, the net area of every wall without its doors and windows, both also in all, and the
    volume between each floor and its ceiling. What was seen of them: see ``Quantity.closed``.

    Args:
        heights: The dimensions of that kind.
        astray: Instances whose extents are out of all proportion: they have no area, and none of all is closed.
    """
    found: list[tuple[Quantity, Measurable]] = []
    kinds: tuple[tuple[QuantityKind, Label], ...] = (("floor area", "floor"), ("net wall area", "wall"))
    for kind, label in kinds:
        every = [i for i in room.seen if room.instances[i].label == label]
        each = [i for i in every if i not in astray]
        own = [(Quantity(kind, (i,), 0.0, np.nan, closed), area) for i in each for area, closed in (_net(room, i),)]
        found += own
        if len(own) > 1:
            total = own[0][1]
            for _, area in own[1:]:
                total = total.plus(area)
            closed = each == every and all(one.closed for one, _ in own)
            found.append((Quantity(kind, tuple(each), 0.0, np.nan, closed), total))
    areas = {one.instances: (one, area) for one, area in found if one.kind == "floor area"}
    for dimension, height in heights:
        if (dimension.first,) in areas:
            floor, area = areas[dimension.first,]
            both = (dimension.first, dimension.second)
            found.append((Quantity("volume", both, 0.0, np.nan, floor.closed), area.times(height)))
    return [(replace(one, amount=measured.value), measured) for one, measured in found]


def _net(room: SolvedRoom, index: int) -> tuple[Measurable, bool]:
    """The area of an instance without its openings, and whether its region is closed."""
    area, closed = _area(room, index)
    for i in room.seen:
        if room.instances[i].host == index:
            area = area.plus(_area(room, i)[0], -1.0)
    return area, closed


def _area(room: SolvedRoom, index: int) -> tuple[Measurable, bool]:
    """Of a curved wall it is known as its radius is; whether its outline is closed is not looked at."""
    extent, normal = room.extents[index], room.planes[index].normal
    if strip := strip_of(extent):
        share = strip.cylinder.sigma_radius / strip.cylinder.radius
        return Measurable(extent.region.area, np.zeros(4 * len(room.planes)), share * extent.region.area), False
    gradient = np.zeros(4 * len(room.planes))
    fixed = total = drawn = 0.0
    for polygon in polygons(extent.region.simplify(_STRAIGHT_SHARE * room.size)).geoms:
        turned = orient(polygon)
        for ring in (turned.exterior, *turned.interiors):
            points = extent.frame.to_world(shapely.get_coordinates(ring)[:-1])
            others = room.on_others(index, points)
            before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
            # Of half the sum of normal · (point × next point).
            by_point = 0.5 * np.cross(after - before, normal)
            gradient += np.einsum("pi,pij->j", by_point, room.motion(index, points, others))
            for p, start in enumerate(points):
                length = float(np.linalg.norm(after[p] - start))
                total += length
                if length == 0 or set(others[p]) & set(others[(p + 1) % len(points)]):
                    fixed += length
                else:
                    drawn += _edge_variance(room, index, start, after[p], length)
    return Measurable(extent.region.area, gradient, float(np.sqrt(drawn))), fixed >= _CLOSED_SHARE * total


def _edge_variance(room: SolvedRoom, index: int, start: FloatArray, end: FloatArray, length: float) -> float:
    """By how much a drawn edge leaves the area open: it may lie to either side as a whole."""
    across = np.cross((end - start) / length, room.planes[index].normal)
    return (length * room.drawn_sigma(index, (start + end) / 2, across)) ** 2
