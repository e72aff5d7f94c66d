"""A layout seen from above: walls as lines on the floor plane, doors and windows as intervals on them.

Pure geometry in world units; ``plan_drawing`` draws it. Walls have no thickness, because a layout knows only their
inner sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.export.floor_level import MIN_SINE, Level, floor_frame
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import PlaneFrame
from gtlayout.layout import Layout
from gtlayout.scene import OPENINGS, FloatArray, Label, Scene

UPRIGHT_SINE = float(np.sin(np.deg2rad(60.0)))
"""Less steep instances are drawn by their outline: their line on the floor may lie far from them."""
CORNER_SHARE = 0.02
"""Walls whose ends come this near their lines' intersection, as a share of the plan's size, meet there (6 m: 12 cm)."""
BAND_SIGMAS = 2.0
MAX_BAND_SHARE = 0.5
"""A band reaches no further to either side than this share of its wall's length: a wider band has no meaning."""
_BAND_POINTS = 9
_SAME_SHARE = 1e-9
"""Lengths that differ by less are equal."""


@dataclass(frozen=True)
class Footprint:
    """The line in which an upright instance meets the floor plane."""

    name: str
    label: Label
    ends: FloatArray
    """(2, 2) in the plan."""
    inside: FloatArray
    """(2,) unit vector across it, towards the cameras."""
    drawn: FloatArray
    """(N, 2) intervals on it, as distances from the first end: without openings and parts that were not seen."""
    band: FloatArray
    """(N, 2) corners of the area within two σ of the plane; none where σ is not known."""

    @property
    def length(self) -> float:
        """World unit."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    def at(self, distances: FloatArray) -> FloatArray:
        """(N,) distances from the first end → (N, 2) points."""
        return self.ends[0] + distances[:, None] * (self.ends[1] - self.ends[0]) / max(self.length, 1e-300)


@dataclass(frozen=True)
class Outline:
    """An instance that is not upright, projected on the floor plane."""

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
    walls: tuple[Footprint, ...]
    openings: tuple[Footprint, ...]
    """On the line of their wall; on their own plane's where they have no host."""
    outlines: tuple[Outline, ...]
    """Floors, slanted instances, and windows in these."""
    dimensions: tuple[PlanDimension, ...]
    metric: bool

    @property
    def bounds(self) -> FloatArray:
        """(2, 2) lowest and highest coordinates of all that is in it."""
        points = [one.ends for one in (*self.walls, *self.openings)] + [wall.band for wall in self.walls]
        points += [shapely.get_coordinates(one.region) for one in self.outlines]
        every = np.concatenate(points)
        return np.stack([every.min(axis=0), every.max(axis=0)])


def floor_plan(scene: Scene, layout: Layout) -> FloorPlan:
    """The plan of a layout. Instances that are not placed, and ceilings, are not in it.

    Raises GtlayoutError when there is nothing to draw, or when the direction up is not known.
    """
    seen = [i for i, plane in enumerate(layout.planes) if plane.observable and not layout.extents[i].region.is_empty]
    frame, level = floor_frame(scene, layout, seen)
    frame = _along_longest_wall(frame, [f for i in seen if (f := _footprint(layout, i, frame))])
    lines = {i: line for i in seen if (line := _footprint(layout, i, frame))}
    walls = {i: line for i, line in lines.items() if line.label not in OPENINGS}
    hosts = {i: layout.instances[i].host for i in lines if i not in walls}
    openings = {
        i: lines[i] if host is None else _on_line(lines[i], walls[host])
        for i, host in hosts.items()
        if host is None or host in walls
    }
    joined = dict(zip(walls, _join_corners(tuple(walls.values())), strict=True))
    cut = [
        _with_band(
            _without(wall, [one for j, one in openings.items() if layout.instances[j].host == i]), layout, i, frame
        )
        for i, wall in joined.items()
    ]
    outlines = tuple(
        Outline(layout.instances[i].name, layout.instances[i].label, _dropped(layout, i, frame))
        for i in seen
        if layout.instances[i].label != "ceiling" and i not in walls and i not in openings
    )
    if not (lines or outlines):
        raise GtlayoutError("no floor plan: the layout has no wall, floor or slanted surface whose place is known")
    names = [instance.name for instance in layout.instances]
    dimensions = tuple(
        PlanDimension(
            one.kind, (names[one.first], names[one.second]), one.length, one.sigma, frame.to_plane(one.ends_world)
        )
        for one in layout.dimensions
        if one.kind == "height" or one.kind == "width"  # noqa: PLR1714 mypy narrows only these
    )
    return FloorPlan(frame, level, tuple(cut), tuple(openings.values()), outlines, dimensions, layout.metric)


def _footprint(layout: Layout, i: int, frame: PlaneFrame) -> Footprint | None:
    """Where an upright wall, door or window meets the floor plane; None for other instances."""
    instance, plane = layout.instances[i], layout.planes[i]
    across = frame.axes @ plane.normal
    sine = float(np.linalg.norm(across))
    if instance.label not in ("wall", *OPENINGS) or sine < UPRIGHT_SINE:
        return None
    inside = across / sine
    foot = -(plane.normal @ frame.origin + plane.d) / sine * inside
    along = np.array([inside[1], -inside[0]])
    pieces = []
    for piece in layout.extents[i].region.geoms:
        reach = (frame.to_plane(layout.extents[i].frame.to_world(shapely.get_coordinates(piece))) - foot) @ along
        pieces.append((float(reach.min()), float(reach.max())))
    merged = _union(pieces)
    first, last = merged[0, 0], merged[-1, 1]
    ends = foot + np.outer([first, last], along)
    return Footprint(instance.name, instance.label, ends, inside, merged - first, np.empty((0, 2)))


def _on_line(opening: Footprint, wall: Footprint) -> Footprint:
    """The opening dropped onto its wall's line."""
    along = (wall.ends[1] - wall.ends[0]) / max(wall.length, 1e-300)
    first, last = np.sort((opening.ends - wall.ends[0]) @ along)
    ends = wall.ends[0] + np.outer([first, last], along)
    return replace(opening, ends=ends, inside=wall.inside, drawn=np.array([[0.0, last - first]]))


def _join_corners(walls: Sequence[Footprint]) -> list[Footprint]:
    """Walls that nearly reach their lines' intersection end there."""
    if not walls:
        return []
    every = np.concatenate([wall.ends for wall in walls])
    reach = CORNER_SHARE * float(np.linalg.norm(np.ptp(every, axis=0)))
    joined = []
    for wall in walls:
        ends = wall.ends.copy()
        for e in range(2):
            corners = [c for other in walls if (c := _corner(wall, other)) is not None and _gap(other, c) < reach]
            near = min(corners, key=lambda c: float(np.linalg.norm(c - wall.ends[e])), default=None)
            if near is not None and np.linalg.norm(near - wall.ends[e]) < reach:
                ends[e] = near
        along = (wall.ends[1] - wall.ends[0]) / max(wall.length, 1e-300)
        first, last = (ends - wall.ends[0]) @ along
        drawn = wall.drawn.copy()
        drawn[0, 0], drawn[-1, 1] = first, last
        joined.append(replace(wall, ends=ends, drawn=drawn - first) if first < last else wall)
    return joined


def _corner(one: Footprint, other: Footprint) -> FloatArray | None:
    """(2,) where two lines cross; None when they are nearly parallel."""
    normals = np.stack([one.inside, other.inside])
    if abs(np.linalg.det(normals)) < MIN_SINE:
        return None
    crossing: FloatArray = np.linalg.solve(normals, [one.inside @ one.ends[0], other.inside @ other.ends[0]])
    return crossing


def _gap(wall: Footprint, point: FloatArray) -> float:
    """From a point to the nearer end."""
    return float(np.linalg.norm(wall.ends - point, axis=1).min())


def _without(wall: Footprint, openings: Sequence[Footprint]) -> Footprint:
    """The wall with gaps where its doors and windows are."""
    along = (wall.ends[1] - wall.ends[0]) / max(wall.length, 1e-300)
    drawn = [(float(a), float(b)) for a, b in wall.drawn]
    for opening in openings:
        low, high = np.sort((opening.ends - wall.ends[0]) @ along)
        drawn = [part for a, b in drawn for part in ((a, min(b, low)), (max(a, high), b)) if part[0] < part[1]]
    return replace(wall, drawn=np.array(drawn).reshape(-1, 2))


def _with_band(wall: Footprint, layout: Layout, i: int, frame: PlaneFrame) -> Footprint:
    points = wall.at(np.linspace(0.0, wall.length, _BAND_POINTS))
    sigma = layout.planes[i].sigma_offset(frame.to_world(points))
    if not np.isfinite(sigma).all():
        return wall
    reach = np.minimum(BAND_SIGMAS * sigma, MAX_BAND_SHARE * wall.length)[:, None] * wall.inside
    return replace(wall, band=np.concatenate([points + reach, (points - reach)[::-1]]))


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


def _dropped(layout: Layout, i: int, frame: PlaneFrame) -> MultiPolygon:
    own = layout.extents[i].frame
    return polygons(shapely.transform(layout.extents[i].region, lambda uv: frame.to_plane(own.to_world(uv))))


def _union(intervals: Sequence[tuple[float, float]]) -> FloatArray:
    """(N, 2) disjoint, in order."""
    merged: list[list[float]] = []
    for low, high in sorted(intervals):
        if merged and low <= merged[-1][1]:
            merged[-1][1] = max(merged[-1][1], high)
        else:
            merged.append([low, high])
    return np.array(merged)
