"""Floors, ceilings and slanted surfaces over a whole room."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon

from gtlayout.closing.storey import Level, Storey
from gtlayout.geometry.polygons import polygons
from gtlayout.scene import FloatArray

_PARALLEL_COS = float(np.cos(np.deg2rad(10.0)))


def covering(storey: Storey, level: Level, index: int) -> MultiPolygon:
    """What a floor, ceiling or slanted surface covers, in plan: what is seen of it, and what is its own of its rooms.

    The part of a room of which no floor is seen belongs to the floor beside it. Of ceilings and slanted surfaces that
    meet, the lower one covers the room.
    """
    planes = storey.layout.planes
    group = storey.floors if index in storey.floors else storey.uppers
    seen = {j: storey.seen(j) for j in group}
    known = shapely.union_all(list(seen.values())).buffer(storey.same / 4, join_style="mitre")
    own = [seen[index]]
    for room in level.rooms:
        here = [j for j in group if seen[j].intersection(room).area > storey.config.least_seen * room.area]
        if index not in here:
            continue
        meeting = [j for j in here if abs(planes[j].normal @ planes[index].normal) < _PARALLEL_COS]
        beside = {j: seen[j] for j in here if j not in meeting}
        for part in _cut(
            polygons(room.difference(known)), [storey.plan.trace(planes[j], planes[index]) for j in meeting]
        ):
            point = np.append(shapely.get_coordinates(part.representative_point())[0], 1.0)
            lowest = all(storey.plan.trace(planes[j], planes[index]) @ point > 0 for j in meeting)
            if lowest and _is_beside(part, index, beside, storey):
                own.append(part)
    return polygons(shapely.union_all(own, grid_size=storey.grid))


def _cut(region: MultiPolygon, lines: Sequence[FloatArray]) -> list[Polygon]:
    if not lines or region.is_empty:
        return list(region.geoms)
    low, high = np.reshape(region.bounds, (2, 2))
    reach = float(np.linalg.norm(high - low))
    middle = (low + high) / 2
    cuts = []
    for line in lines:
        normal = line[:2] / np.linalg.norm(line[:2])
        foot = middle - (line @ np.append(middle, 1.0)) / np.linalg.norm(line[:2]) * normal
        along = np.array([normal[1], -normal[0]])
        cuts.append(LineString([foot - reach * along, foot + reach * along]))
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all([region.boundary, *cuts])]))
    return [face for face in faces if shapely.contains(region, face.representative_point())]


def _is_beside(part: Polygon, index: int, seen: Mapping[int, MultiPolygon], storey: Storey) -> bool:
    """Whether a part of a room belongs to a surface rather than to those that are parallel to it."""
    if len(seen) == 1:
        return True
    border = part.boundary
    contact = {j: border.intersection(region.buffer(storey.same)).length for j, region in seen.items()}
    return contact[index] >= storey.config.least_contact * sum(contact.values()) > 0
