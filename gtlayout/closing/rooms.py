"""The rooms in plan at the height of one surface: what is free, and what walls close off behind it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import LineString, MultiPolygon, Polygon

from gtlayout.closing.walls import Wall
from gtlayout.geometry.polygons import polygons


def rooms(
    free: MultiPolygon, walls: Mapping[int, Wall], stands: Mapping[int, Sequence[LineString]], same: float, grid: float
) -> tuple[MultiPolygon, ...]:
    """Each room in plan: what is free, and the corners that walls close off behind it. Walls separate rooms.

    A corner is closed off when only lines of sight and the fronts of walls surround it. ``stands`` is where each wall
    stands.
    """
    # What is seen beside a wall's end reaches a little behind the wall: errors of planes and drawings.
    lines = [_longer(line, 2 * same) for of_one in stands.values() for line in of_one]
    lines += [
        LineString([wall.at(float(end.eye @ wall.along)), end.eye])
        for wall in walls.values()
        for end in wall.ends
        if end.eye is not None
    ]
    borders = shapely.union_all([free.boundary, *lines], grid_size=grid)
    faces = [face for face in shapely.get_parts(shapely.polygonize([borders])) if face.area > 0]
    kept = [face for face in faces if _is_room(face, free, walls, stands, same)]
    if not kept:
        return ()
    apart = shapely.union_all(lines).buffer(same / 4, cap_style="flat")
    links = [
        (a, b)
        for a, b in combinations(range(len(kept)), 2)
        if kept[a].boundary.intersection(kept[b].boundary).difference(apart).length > same
    ]
    first, second = np.array(links, dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(links)), (first, second)), shape=(len(kept),) * 2)
    count, room = connected_components(graph, directed=False)
    return tuple(
        polygons(shapely.union_all([kept[f] for f in np.nonzero(room == number)[0]], grid_size=grid))
        for number in range(count)
    )


def _longer(line: LineString, by: float) -> LineString:
    start, end = shapely.get_coordinates(line)
    along = by * (end - start) / line.length
    return LineString([start - along, end + along])


def _is_room(
    face: Polygon,
    free: MultiPolygon,
    walls: Mapping[int, Wall],
    stands: Mapping[int, Sequence[LineString]],
    same: float,
) -> bool:
    if shapely.contains(free, face.representative_point()):
        return True
    behind = [
        LineString(shapely.get_coordinates(line) - same / 2 * walls[i].line[:2])
        for i, of_one in stands.items()
        for line in of_one
    ]
    return all(line.intersection(face).length <= same for line in behind)
