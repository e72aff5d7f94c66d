"""Rooms in a floor plan: what was seen of their floors, where walls close it, and where it is open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.export.plan_curves import Curve
from gtlayout.export.plan_walls import Footprint
from gtlayout.geometry.polygons import grid_for, polygons
from gtlayout.scene import FloatArray

_ON_WALL = 1e-3
"""What lies this near a wall's foot, as a share of the tolerance, was put on it."""
_ON_ARC = 0.25
"""Floors end at curved walls up to this share of the tolerance: the lean of one against the other."""
_SHORT_WALL = 0.25
"""Floors are moved to a wall's foot by no more than this share of the wall's length."""


@dataclass(frozen=True)
class Room:
    """A floor in the plan. Its outline is closed: by the feet of walls, elsewhere by the end of what was seen."""

    name: str
    """Of the floor."""
    region: MultiPolygon
    """What was seen of it, up to the feet of the walls that it nearly reaches."""
    open: tuple[FloatArray, ...]
    """(N, 2) the parts of its outline along which no wall stands."""
    weak: bool
    """A wall whose place is hardly known is part of the outline."""
    inferred: MultiPolygon
    """What continues the floor where nobody looked."""
    inferred_outline: tuple[FloatArray, ...]
    """(N, 2) its outline, but for the end of what was seen and the feet of walls, seen or inferred."""

    @property
    def area(self) -> float:
        """Of what was seen, square world units."""
        return float(self.region.area)


def room(
    name: str,
    seen: MultiPolygon,
    inferred: MultiPolygon,
    lines: Sequence[Footprint],
    openings: Sequence[Footprint],
    tolerance: float,
    curves: Sequence[Curve] = (),
) -> Room:
    """The room of a floor; ``lines``, of walls and of openings without one, close it where it ends near them.

    Nearer than ``tolerance``, that is. So do ``curves``, up to which floors go already. ``openings`` are those in the
    walls.
    """
    region = seen
    for one in lines:
        region = _up_to(region, one, min(tolerance, _SHORT_WALL * one.length))
    region = _without_slivers(region, tolerance)
    feet = [[LineString(one.ends) for one in lines if one.weak is weak] for weak in (False, True)]
    arcs = [[LineString(one.points) for one in curves if one.weak is weak] for weak in (False, True)]
    known, weak = (
        shapely.union_all(
            [foot.buffer(_ON_WALL * tolerance) for foot in some] + [arc.buffer(_ON_ARC * tolerance) for arc in bent]
        )
        for some, bent in zip(feet, arcs, strict=True)
    )
    by_known = region.boundary.difference(known)
    left = by_known.difference(weak)
    more = polygons(inferred.difference(region))
    guessed = [LineString(one.at(part)) for one in (*lines, *openings) for part in one.inferred]
    drawn = [region.boundary, *guessed, *feet[0], *feet[1], *arcs[0], *arcs[1]]
    rest = more.boundary.difference(shapely.union_all(drawn).buffer(_ON_WALL * tolerance))
    weak_length = float(by_known.length - left.length)
    return Room(name, region, _lines(left, tolerance), weak_length > tolerance, more, _lines(rest, tolerance))


def _lines(geometry: BaseGeometry, shortest: float) -> tuple[FloatArray, ...]:
    """(N, 2) each: the lines in it, joined, without the shortest."""
    merged = shapely.line_merge(geometry) if geometry.geom_type == "MultiLineString" else geometry
    lines = shapely.get_parts(merged.simplify(_ON_WALL * shortest))
    return tuple(shapely.get_coordinates(line) for line in lines if line.length > shortest)


def _up_to(region: MultiPolygon, wall: Footprint, tolerance: float) -> MultiPolygon:
    """The region with its border moved to the wall's foot, where it ends within ``tolerance`` on either side.

    Floors are drawn up to the contact edge, which lies some centimetres from where the solved planes meet.
    """
    inside, outside = (_covered(region, wall, away) for away in (tolerance, -tolerance))
    filled = region.union(_strips(wall, inside, tolerance))
    everywhere = np.array([0.0, wall.length])
    beyond = _strip(wall, everywhere, -tolerance).difference(_strips(wall, outside, -tolerance))
    # A floor that lies on the far side ends at the wall, too.
    before = _strips(wall, outside, tolerance).difference(_strips(wall, inside, tolerance))
    return polygons(filled.difference(beyond).difference(before))


def _without_slivers(region: MultiPolygon, tolerance: float) -> MultiPolygon:
    """The region without what hangs on it by a thread, such as what was cut off behind two walls' corner."""
    step = _ON_WALL * tolerance
    # Corners that differ by rounding alone would be bevelled.
    clean = _simplified(polygons(shapely.set_precision(region, grid_for(tolerance))), _ON_WALL * step)
    parts = polygons(clean.buffer(-step, join_style="mitre")).geoms
    large = MultiPolygon([part for part in parts if part.area > tolerance**2])
    whole = large.buffer(step, join_style="mitre")
    # The same corners, from the same one on, whatever the last bits of the planes are.
    return _simplified(polygons(shapely.set_precision(whole, grid_for(tolerance)).normalize()), step)


def _simplified(region: MultiPolygon, step: float) -> MultiPolygon:
    """The region without corners that lie within ``step`` of the line between their neighbours.

    Twice, from another corner on: the one at which a ring begins is never left out.
    """
    for _ in range(2):
        turned = [
            [np.roll(corners, len(corners) // 2, axis=0) for corners in rings]
            for rings in _rings(region.simplify(step))
        ]
        region = MultiPolygon([Polygon(outer, holes) for outer, *holes in turned])
    return polygons(region.normalize())


def _rings(region: BaseGeometry) -> list[list[FloatArray]]:
    """Per polygon its outer ring and its holes, (N, 2) each, without the repeated last point."""
    return [
        [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
        for polygon in polygons(region).geoms
    ]


def _covered(region: BaseGeometry, wall: Footprint, away: float) -> list[FloatArray]:
    """(2,) intervals along the wall in which the region reaches a line so far from its foot."""
    parts = shapely.get_parts(region.intersection(LineString(wall.ends + away * wall.inside)))
    reach = [(shapely.get_coordinates(part) - wall.ends[0]) @ wall.along for part in parts if part.length > 0]
    return [np.array([one.min(), one.max()]) for one in reach]


def _strips(wall: Footprint, intervals: Sequence[FloatArray], away: float) -> BaseGeometry:
    return shapely.union_all([_strip(wall, interval, away) for interval in intervals])


def _strip(wall: Footprint, interval: FloatArray, away: float) -> Polygon:
    """The rectangle along a part of the wall's foot, to one side of it."""
    foot = wall.at(interval)
    return Polygon([*foot, *(foot[::-1] + away * wall.inside)])
