"""A layout seen from above: walls as lines on the floor plane, doors and windows as intervals on them, rooms.

Pure geometry in world units; ``plan_drawing`` draws it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.export.floor_level import Level, floor_frame
from gtlayout.export.plan_curves import Curve, curve
from gtlayout.export.plan_rooms import Room, room
from gtlayout.export.plan_walls import (
    CORNER_SHARE,
    Footprint,
    footprint,
    join_corners,
    on_line,
    with_certainty,
    without,
)
from gtlayout.geometry.polygons import polygons
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import Extent, PlaneFrame
from gtlayout.layout import Layout
from gtlayout.scene import OPENINGS, FloatArray, Label, Scene

_SAME_SHARE = 1e-9
"""Lengths that differ by less are equal."""


@dataclass(frozen=True)
class Outline:
    """An instance that is neither upright nor a floor, projected on the floor plane."""

    name: str
    label: Label
    region: MultiPolygon


@dataclass(frozen=True)
class PlanDimension:
    """The distance of two walls, or (``ends`` without meaning) of floor and ceiling."""

    kind: Literal["height", "width"]
    names: tuple[str, str]
    length: float
    sigma: float
    ends: FloatArray
    """(2, 2) where it is measured, in the plan."""


@dataclass(frozen=True)
class FloorPlan:
    """Everything that is drawn. Its frame's first axis runs along the longest wall, its normal is up."""

    frame: PlaneFrame
    """Plan coordinates in the world."""
    level: Level
    """What the floor plane was taken from."""
    rooms: tuple[Room, ...]
    walls: tuple[Footprint, ...]
    """The flat ones."""
    curves: tuple[Curve, ...]
    """The curved ones."""
    openings: tuple[Footprint, ...]
    """On the line of their wall; on their own plane's where they have no host."""
    outlines: tuple[Outline, ...]
    """Slanted instances, and windows in these."""
    dimensions: tuple[PlanDimension, ...]
    metric: bool

    @property
    def bounds(self) -> FloatArray:
        """(2, 2) lowest and highest coordinates of all that is in it."""
        lines = (*self.walls, *self.openings)
        points = [one.ends for one in lines] + [one.at(one.inferred.ravel()) for one in lines]
        points += [wall.band for wall in self.walls]
        points += [part for one in self.curves for part in (one.band, one.points)]
        regions = [one.region for one in self.outlines] + [
            part for one in self.rooms for part in (one.region, one.inferred)
        ]
        points += [shapely.get_coordinates(region) for region in regions]
        every = np.concatenate(points)
        return np.stack([every.min(axis=0), every.max(axis=0)])


def floor_plan(scene: Scene, layout: Layout) -> FloorPlan:
    """The plan of a layout. Instances that are not placed, and ceilings, are not in it.

    Raises GtlayoutError when there is nothing to draw, or when the direction up is not known.
    """
    seen = [i for i, plane in enumerate(layout.planes) if plane.observable and not layout.extents[i].region.is_empty]
    frame, level = floor_frame(scene, layout, seen)
    frame = _along_longest_wall(frame, [f for i in seen if (f := footprint(layout, i, frame))])
    lines = {i: line for i in seen if (line := footprint(layout, i, frame))}
    walls = {i: line for i, line in lines.items() if line.label not in OPENINGS}
    hosts = {i: layout.instances[i].host for i in lines if i not in walls}
    round_walls = [i for i in seen if strip_of(layout.extents[i])]
    openings = {
        i: lines[i] if host is None or host in round_walls else on_line(lines[i], walls[host])
        for i, host in hosts.items()
        if host is None or host in walls or host in round_walls
    }
    others = [i for i in seen if i not in (*walls, *openings, *round_walls) and layout.instances[i].label != "ceiling"]
    if not (lines or others or round_walls):
        raise GtlayoutError("no floor plan: the layout has no wall, floor or slanted surface whose place is known")
    regions = {i: _dropped(layout.extents[i], frame) for i in others}
    size = _size([one.ends for one in lines.values()] or [shapely.get_coordinates(one) for one in regions.values()])
    joined = dict(zip(walls, join_corners(tuple(walls.values()), CORNER_SHARE * size), strict=True))
    cut = [
        with_certainty(
            without(wall, [one for j, one in openings.items() if layout.instances[j].host == i]), layout, i, frame, size
        )
        for i, wall in joined.items()
    ]
    names = [instance.name for instance in layout.instances]
    curves = tuple(found for i in round_walls if (found := curve(layout, i, frame, size)))
    on_the_floor = [*cut, *(one for i, one in openings.items() if hosts[i] is None)]
    return FloorPlan(
        frame,
        level,
        tuple(
            room(
                names[i],
                regions[i],
                _dropped(layout.inferred[i], frame) if layout.inferred else MultiPolygon(),
                on_the_floor,
                tuple(openings.values()),
                CORNER_SHARE * size,
                curves,
            )
            for i in others
            if layout.instances[i].label == "floor"
        ),
        tuple(cut),
        curves,
        tuple(openings.values()),
        tuple(
            Outline(names[i], layout.instances[i].label, regions[i])
            for i in others
            if layout.instances[i].label != "floor"
        ),
        tuple(
            PlanDimension(
                one.kind, (names[one.first], names[one.second]), one.length, one.sigma, frame.to_plane(one.ends_world)
            )
            for one in layout.dimensions
            if one.kind == "height" or one.kind == "width"  # noqa: PLR1714 mypy narrows only these
        ),
        layout.metric,
    )


def _size(points: Sequence[FloatArray]) -> float:
    """Of all points, (N, 2) each, from corner to corner."""
    return float(np.linalg.norm(np.ptp(np.concatenate(points), axis=0)))


def _along_longest_wall(frame: PlaneFrame, lines: Sequence[Footprint]) -> PlaneFrame:
    """The frame turned so that the longest wall is level, with the room below it, and the origin is unchanged."""
    walls = [line for line in lines if line.label == "wall"]
    if not walls:
        return frame
    # The first of the longest: in a room of right angles two are as long, but for rounding.
    longest = max(wall.length for wall in walls)
    down = next(wall for wall in walls if wall.length > (1 - _SAME_SHARE) * longest).inside
    turn = np.array([[-down[1], down[0]], [-down[0], -down[1]]])
    return PlaneFrame(frame.origin, turn @ frame.axes)


def _dropped(extent: Extent, frame: PlaneFrame) -> MultiPolygon:
    return polygons(shapely.transform(extent.region, lambda uv: frame.to_plane(extent.frame.to_world(uv))))
