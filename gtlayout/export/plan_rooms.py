"""Rooms in a floor plan: what was seen of their floors, where walls close it, and where it is open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely import LineString, MultiPolygon

from gtlayout.export.plan_walls import Footprint
from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class Room:
    """A floor in the plan. Its outline is closed: by the feet of walls, elsewhere by the end of what was seen."""

    name: str
    """Of the floor."""
    region: MultiPolygon
    """What was seen of it."""
    open: tuple[FloatArray, ...]
    """(N, 2) the parts of its outline along which no wall stands."""
    weak: bool
    """A wall whose place is hardly known is part of the outline."""
    inferred: MultiPolygon
    """What continues the floor where nobody looked."""

    @property
    def area(self) -> float:
        """Of what was seen, square world units."""
        return float(self.region.area)


def room(name: str, region: MultiPolygon, inferred: MultiPolygon, lines: Sequence[Footprint], tolerance: float) -> Room:
    """The room of a floor; its outline is closed where it runs within ``tolerance`` of one of the ``lines``."""
    outline = region.boundary
    feet = {weak: [LineString(one.ends) for one in lines if one.weak is weak] for weak in (False, True)}
    known, weak = (
        shapely.union_all([foot.buffer(tolerance, cap_style="flat") for foot in feet[state]]) for state in (False, True)
    )
    by_known = outline.difference(known)
    left = by_known.difference(weak)
    merged = shapely.line_merge(left) if left.geom_type == "MultiLineString" else left
    pieces = [part for part in shapely.get_parts(merged) if part.length > tolerance]
    return Room(
        name,
        region,
        tuple(shapely.get_coordinates(piece) for piece in pieces),
        bool(by_known.length - left.length > tolerance),
        MultiPolygon(inferred),
    )
