"""Bodies behind the surfaces of a layout: each outline moved outwards by a thickness, mitred where surfaces touch.

A layout knows the sides of walls, floors and ceilings that face the room. Their bodies lie behind: the front is the
outline as measured, the back the same outline one thickness behind it. Where an edge touches another surface, the back
reaches to the line in which both surfaces, moved outwards, meet. So the outer corners are closed, and no front moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon

from gtlayout.dimensions.facing import MAX_ANGLE_DEG
from gtlayout.export.solid import Corner, Solid, between, crosses_itself
from gtlayout.instances import PlaneFrame
from gtlayout.scene import FloatArray

REACH = 0.5
"""Edges this near to another surface, as a share of the thickness, touch it: extents end a few centimetres beside the
line in which their planes meet."""
MITRE_LIMIT = 3.0
"""A mitre reaches this far beyond its edge, in thicknesses; beyond it, at angles below 37°, the corner stays open."""
_ALONG_SINE = 0.5
"""An edge that runs at more than 30° to the line in which two planes meet does not touch along it."""
_SAME_LINE_SINE = 0.35
"""Sides that turn by less than 20° have no corner that both reach: a triangle is between them."""
_MIN_SHARE = 0.02
"""Contacts shorter than this share of the thickness are none."""
_BUFFER_SEGMENTS = 4
_TRIALS = 16
_STRAIGHT = 1e-9
"""World unit; sides that are shifted by less go straight back."""
_LEAST_SIDES = 3


@dataclass(frozen=True)
class Surface:
    """A flat region to be given a body."""

    frame: PlaneFrame
    """Its normal is on the room's side."""
    region: MultiPolygon
    """What touches others: openings are part of it."""
    solid: MultiPolygon
    """What gets a body: openings are cut out."""
    thickness: float


@dataclass(frozen=True)
class _Side:
    """One edge of an outline, and the line a·x = c of the back that belongs to it, in the surface's own frame."""

    start: FloatArray
    end: FloatArray
    """(2,) its ends."""
    across: FloatArray
    """(2,) a, unit vector."""
    offset: float
    """c."""

    @classmethod
    def straight(cls, start: FloatArray, end: FloatArray) -> _Side:
        """Straight back from an edge."""
        across = np.array([end[1] - start[1], start[0] - end[0]]) / np.linalg.norm(end - start)
        return cls(start, end, across, float(across @ start))

    def foot(self, point: FloatArray) -> FloatArray:
        """(2,) the nearest point of the back's line."""
        found: FloatArray = point + (self.offset - self.across @ point) * self.across
        return found

    @property
    def length(self) -> float:
        """Of the edge."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def shift(self) -> float:
        """How far the back's line is from the middle of the edge."""
        return abs(self.offset - float(self.across @ (self.start + self.end)) / 2)


def bodies(surfaces: Sequence[Surface]) -> list[tuple[Solid, ...]]:
    """The solids of each surface, one a polygon, in the surface's frame: (u, v, along the normal)."""
    near = [_Near.of(surface) for surface in surfaces]
    return [
        tuple(
            _solid([_sides_of(ring, i, surfaces, near) for ring in _rings(polygon)], surface.thickness)
            for polygon in surface.solid.geoms
        )
        for i, surface in enumerate(surfaces)
    ]


def _solid(rings: list[list[_Side]], thickness: float) -> Solid:
    """The solid of one polygon.

    Where its back would cross itself, edges go straight back: the shortest one that helps, else the shortest and then
    others.
    """
    front, back = np.zeros(3), np.array([0.0, 0.0, -thickness])
    corners = [_corners(ring) for ring in rings]
    if not crosses_itself(corners):
        return between(corners, front, back)
    while mitred := sorted((s for ring in rings for s in ring if s.shift > _STRAIGHT), key=lambda s: s.length):
        # Many at once where there are many, so that the time does not grow with their square.
        many = max(1, len(mitred) // _TRIALS)
        trials = [mitred[k : k + many] for k in range(0, len(mitred), many)]
        for straightened in trials:
            corners = [_corners(_straight(ring, straightened)) for ring in rings]
            if not crosses_itself(corners):
                return between(corners, front, back)
        rings = [_straight(ring, trials[0]) for ring in rings]
    return between([[(side.start, [side.start]) for side in ring] for ring in rings], front, back)


def _straight(ring: Sequence[_Side], some: Sequence[_Side]) -> list[_Side]:
    """The ring with some of its sides straight back."""
    these = {id(side) for side in some}
    return [_Side.straight(side.start, side.end) if id(side) in these else side for side in ring]


@dataclass(frozen=True)
class _Near:
    """What is near a surface's border and inside it, in its own frame."""

    reach: float
    border: shapely.Geometry
    inside: shapely.Geometry

    @classmethod
    def of(cls, surface: Surface) -> _Near:
        reach = REACH * surface.thickness
        border = surface.region.boundary.buffer(reach, quad_segs=_BUFFER_SEGMENTS)
        return cls(reach, border, surface.region.difference(border))


def _rings(polygon: Polygon) -> list[FloatArray]:
    """Outer ring, counter-clockwise, and holes, clockwise: the surface lies to the left. Without the last point."""
    turned = shapely.orient_polygons(polygon)
    return [shapely.get_coordinates(ring)[:-1] for ring in (turned.exterior, *turned.interiors)]


def _meet(one: PlaneFrame, other: PlaneFrame) -> bool:
    sine = np.linalg.norm(np.cross(_normal(one), _normal(other)))
    return bool(sine > np.sin(np.deg2rad(MAX_ANGLE_DEG)))


def _sides_of(ring: FloatArray, i: int, surfaces: Sequence[Surface], near: Sequence[_Near]) -> list[_Side]:
    others = [
        (other, around)
        for j, (other, around) in enumerate(zip(surfaces, near, strict=True))
        if j != i and _meet(surfaces[i].frame, other.frame)
    ]
    edges = zip(ring, np.roll(ring, -1, axis=0), strict=True)
    return [side for start, end in edges if (start != end).any() for side in _sides(surfaces[i], start, end, others)]


def _sides(
    surface: Surface, start: FloatArray, end: FloatArray, others: Sequence[tuple[Surface, _Near]]
) -> list[_Side]:
    """The sides of one edge: cut where what it touches begins and ends."""
    contacts = [one for other, near in others for one in _contacts(surface, other, near, start, end)]
    shortest = min(_MIN_SHARE * surface.thickness / float(np.linalg.norm(end - start)), 1.0)
    cuts = [0.0]
    for share in sorted(share for low, high, _, _ in contacts for share in (low, high)):
        if share - cuts[-1] > shortest and 1 - share > shortest:
            cuts.append(share)
    most = MITRE_LIMIT * surface.thickness
    sides = []
    for low, high in pairwise([*cuts, 1.0]):
        middle = (low + high) / 2
        side = _Side.straight(start + low * (end - start), start + high * (end - start))
        here = [(gap, line) for first, last, gap, line in contacts if first <= middle <= last]
        if here:
            # The nearest of several; the first of these.
            across, offset = min(here, key=lambda one: one[0])[1]
            place = float(across @ (start + middle * (end - start)))
            side = replace(side, across=across, offset=float(np.clip(offset, place - most, place + most)))
        sides.append(side)
    return sides


def _contacts(
    surface: Surface, other: Surface, near: _Near, start: FloatArray, end: FloatArray
) -> list[tuple[float, float, float, tuple[FloatArray, float]]]:
    """Where an edge touches another surface: from, to as shares of the edge, mean distance, and the back's line there.

    Along the border of the other surface both make a corner, and the line is that in which both, moved outwards, meet.
    Elsewhere the edge stands on it, and the body ends at its front.
    """
    ends = surface.frame.to_world(np.stack([start, end]))
    normal = _normal(other.frame)
    heights = (ends - other.frame.origin) @ normal
    across = surface.frame.axes @ normal
    size = float(np.linalg.norm(across))
    direction = (end - start) / np.linalg.norm(end - start)
    segment = LineString(other.frame.to_plane(ends))
    if np.abs(heights).min() > near.reach or abs(across @ direction) > _ALONG_SINE * size or segment.length == 0:
        return []
    # The surface lies to the left of its edges: before the other surface, or behind it.
    before = bool(across @ [-direction[1], direction[0]] > 0)
    # Of the moved plane of the other, n·(origin + u e_u + v e_v − t n_own) = n·origin_other − t_other.
    own = surface.thickness * float(_normal(surface.frame) @ normal)
    level = float((other.frame.origin - surface.frame.origin) @ normal) + own
    found = []
    for region, is_border in ((near.border, True), (near.inside, False)):
        for part in shapely.get_parts(segment.intersection(region)):
            if part.length == 0:
                continue
            low, high = sorted(
                segment.project(shapely.Point(xy)) / segment.length for xy in shapely.get_coordinates(part)[[0, -1]]
            )
            gap = float(np.abs(heights[0] + (low + high) / 2 * (heights[1] - heights[0])))
            if gap > near.reach:
                continue
            corner = is_border and before == _ahead(surface, other, part.centroid.buffer(2 * near.reach))
            if corner or before:
                offset = (level - (other.thickness if corner else 0.0)) / size
                found.append((low, high, gap, (across / size, offset)))
    return found


def _ahead(surface: Surface, other: Surface, place: Polygon) -> bool:
    """Whether another surface lies before this one there, and not behind it."""
    middle = other.frame.to_world(shapely.get_coordinates(other.region.intersection(place).centroid))
    return bool(len(middle) and (middle[0] - surface.frame.origin) @ _normal(surface.frame) > 0)


def _corners(sides: Sequence[_Side]) -> list[Corner]:
    """Per corner of a ring its point of the front and its one or two points of the back.

    A side that the shifts of its neighbours use up has no length in the back: both its corners have the same points.
    """
    kept = list(range(len(sides)))
    while True:
        feet = [_feet(sides[kept[m - 1]], sides[kept[m]]) for m in range(len(kept))]
        used_up = {
            k: (sides[k].length, k)
            for m, k in enumerate(kept)
            if (sides[k].end - sides[k].start) @ (feet[(m + 1) % len(kept)][0] - feet[m][-1]) < 0
        }
        # The shortest of those side by side: without it the others may be as they should.
        gone = {
            k
            for m, k in enumerate(kept)
            if k in used_up and all(used_up[k] <= used_up.get(kept[n % len(kept)], used_up[k]) for n in (m - 1, m + 1))
        }
        if not gone or len(kept) - len(gone) < _LEAST_SIDES:
            break
        kept = [k for k in kept if k not in gone]
    corners: list[Corner] = []
    for m, k in enumerate(kept):
        first = kept[m - 1] + 1 if m else kept[-1] + 1 - len(sides)
        corners += [(sides[j].start, feet[m] if j == first else feet[m][-1:]) for j in range(first, k + 1)]
    return corners


def _feet(before: _Side, after: _Side) -> list[FloatArray]:
    """Where the back's lines of two sides meet; the nearest point on each where they hardly turn."""
    lines = np.stack([before.across, after.across])
    if abs(float(np.linalg.det(lines))) > _SAME_LINE_SINE:
        corner: FloatArray = np.linalg.solve(lines, np.array([before.offset, after.offset]))
        return [corner]
    point = (before.end + after.start) / 2
    return [before.foot(point), after.foot(point)]


def _normal(frame: PlaneFrame) -> FloatArray:
    normal: FloatArray = np.cross(*frame.axes)
    return normal
