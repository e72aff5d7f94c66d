"""Walls between floor and ceiling, from corner to corner."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely
from shapely import LineString, MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.closing.elevation import Elevation
from gtlayout.closing.plan import swept
from gtlayout.closing.storey import Level, Storey
from gtlayout.geometry.polygons import half_plane


def standing(
    storey: Storey, levels: Mapping[int, Level], index: int, covered: Mapping[int, MultiPolygon]
) -> MultiPolygon:
    """What a wall covers between the floors and the upper surfaces that reach to it, in its frame.

    ``covered`` is what each of these covers, in plan. Where only a floor is known, the wall goes down to it from what
    is seen; where only a ceiling is, up.
    """
    layout = storey.layout
    extent, wall = layout.extents[index], storey.walls[index]
    elevation = Elevation.of(storey.plan, wall, extent.frame)
    seen = elevation.seen(extent.region)
    around = shapely.box(*seen.bounds).buffer(storey.reach, join_style="mitre")
    reaching = {
        s: _reaching(levels[s], index, covered[s], around, storey.same) for s in (*storey.floors, *storey.uppers)
    }
    cut = {s: reaching[s].intersection(half_plane(elevation.before(layout.planes[s]), around)) for s in reaching}
    over, under = (shapely.union_all([cut[s] for s in group]) for group in (storey.floors, storey.uppers))
    with_floor, with_upper = (
        shapely.union_all([reaching[s] for s in group]) for group in (storey.floors, storey.uppers)
    )
    down, up = (swept(seen, np.array([0.0, sign * 2 * storey.reach])) for sign in (-1.0, 1.0))
    found = shapely.union_all(
        [
            over.intersection(under),
            over.difference(with_upper).intersection(down),
            under.difference(with_floor).intersection(up),
        ]
    )
    for side, end in enumerate(wall.ends):
        if end.corner is not None:
            half = np.array([1.0, 0.0, -float(wall.middle @ wall.along)]) * (1.0, -1.0)[side]
            kept = (half_plane(line, around) for line in (elevation.before(layout.planes[end.corner]), half))
            found = found.intersection(shapely.union_all(list(kept)))
    return elevation.in_frame(found)


def _reaching(level: Level, index: int, covered: MultiPolygon, around: BaseGeometry, same: float) -> BaseGeometry:
    """The columns of a wall's elevation at whose foot, or head, a surface reaches to the wall."""
    wall = level.walls[index]
    low, high = np.reshape(around.bounds, (2, 2))
    step = same * wall.line[:2]
    columns = []
    for stand in level.stands[index]:
        beside = LineString(shapely.get_coordinates(stand) + step).intersection(covered)
        for part in shapely.get_parts(beside):
            if part.length > same:
                along = shapely.get_coordinates(part) @ wall.along
                columns.append(shapely.box(along.min() - same, low[1], along.max() + same, high[1]))
    return shapely.union_all(columns)
