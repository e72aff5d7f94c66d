"""The feet of upright instances: the lines in which walls, doors and windows meet the floor plane.

Pure geometry in plan coordinates, world unit. Walls have no thickness, because a layout knows only their inner sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.accuracy import SIGMAS_95, UPPER_ENDS_M
from gtlayout.export.floor_level import MIN_SINE
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import PlaneFrame
from gtlayout.layout import Layout
from gtlayout.scene import OPENINGS, FloatArray, Label

UPRIGHT_SINE = float(np.sin(np.deg2rad(60.0)))
"""Less steep instances are drawn by their outline: their line on the floor may lie far from them."""
BAND_SIGMAS = 2.0
WEAK_SHARE = 0.02
"""Without metres a wall is weak when its place is not known to this share of the plan's size (7 m: 14 cm)."""
CORNER_SHARE = 0.02
"""Walls whose ends come this near their lines' intersection, as a share of the plan's size, meet there (6 m: 12 cm)."""
_BAND_POINTS = 9


def _nothing() -> FloatArray:
    return np.empty((0, 2))


@dataclass(frozen=True)
class Footprint:
    """The line in which an upright instance meets the floor plane."""

    name: str
    label: Label
    ends: FloatArray
    """(2, 2) in the plan: of what was seen of it."""
    inside: FloatArray
    """(2,) unit vector across it, towards the cameras."""
    drawn: FloatArray
    """(N, 2) intervals on it, as distances from the first end: without openings and parts that were not seen."""
    inferred: FloatArray = field(default_factory=_nothing)
    """(N, 2) intervals of what continues it where nobody looked; they may lie beyond its ends."""
    band: FloatArray = field(default_factory=_nothing)
    """(N, 2) corners of the area within two σ of the plane; none where the wall is weak."""
    weak: bool = False
    """Its place is not known well enough to build from: worse than the coarsest level of accuracy, or not at all."""
    accuracy_level: int = 0
    """The level of accuracy that it reaches; 0 for none, and where nobody asked."""

    @property
    def length(self) -> float:
        """World unit."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    @property
    def along(self) -> FloatArray:
        """(2,) unit vector from the first end to the second."""
        along: FloatArray = (self.ends[1] - self.ends[0]) / max(self.length, 1e-300)
        return along

    @property
    def reach(self) -> float:
        """Half the width of its band at the widest place; 0 without one."""
        return float(np.abs((self.band - self.ends[0]) @ self.inside).max(initial=0.0))

    def at(self, distances: FloatArray) -> FloatArray:
        """(N,) distances from the first end → (N, 2) points."""
        return self.ends[0] + distances[:, None] * self.along


def footprint(layout: Layout, i: int, frame: PlaneFrame) -> Footprint | None:
    """Where an flat upright wall, door or window that was seen meets the floor plane; None for others."""
    instance, plane, extent = layout.instances[i], layout.planes[i], layout.extents[i]
    across = frame.axes @ plane.normal
    sine = float(np.linalg.norm(across))
    if instance.label not in ("wall", *OPENINGS) or sine < UPRIGHT_SINE or strip_of(extent):
        return None
    inside = across / sine
    foot = -(plane.normal @ frame.origin + plane.d) / sine * inside
    along = np.array([inside[1], -inside[0]])

    def reach(region: MultiPolygon) -> FloatArray:
        pieces = [
            (frame.to_plane(extent.frame.to_world(shapely.get_coordinates(piece))) - foot) @ along
            for piece in region.geoms
        ]
        return _union([(float(piece.min()), float(piece.max())) for piece in pieces])

    seen = reach(extent.region)
    first, last = seen[0, 0], seen[-1, 1]
    ends = foot + np.outer([first, last], along)
    inferred = minus(reach(layout.inferred[i].region), list(seen)) if layout.inferred else _nothing()
    return Footprint(instance.name, instance.label, ends, inside, seen - first, inferred - first)


def on_line(opening: Footprint, wall: Footprint) -> Footprint:
    """The opening dropped onto its wall's line."""
    first, last = np.sort((opening.ends - wall.ends[0]) @ wall.along)
    ends = wall.ends[0] + np.outer([first, last], wall.along)
    drawn = np.array([[0.0, last - first]])
    return replace(opening, ends=ends, inside=wall.inside, drawn=drawn)


def join_corners(walls: Sequence[Footprint], reach: float) -> list[Footprint]:
    """Walls whose ends come nearer than ``reach`` to their lines' intersection end there."""
    joined = []
    for wall in walls:
        ends = wall.ends.copy()
        for e in range(2):
            corners = [c for other in walls if (c := _corner(wall, other)) is not None and _gap(other, c) < reach]
            near = min(corners, key=lambda c: float(np.linalg.norm(c - wall.ends[e])), default=None)
            if near is not None and np.linalg.norm(near - wall.ends[e]) < reach:
                ends[e] = near
        first, last = (ends - wall.ends[0]) @ wall.along
        drawn = wall.drawn.copy()
        drawn[0, 0], drawn[-1, 1] = first, last
        moved = replace(wall, ends=ends, drawn=drawn - first, inferred=wall.inferred - first)
        joined.append(moved if first < last else wall)
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


def without(wall: Footprint, openings: Sequence[Footprint]) -> Footprint:
    """The wall with gaps where its doors and windows are, and what is inferred only where nothing was seen."""
    gaps = [np.sort((opening.ends - wall.ends[0]) @ wall.along) for opening in openings]
    guessed = [
        np.sort((opening.at(part) - wall.ends[0]) @ wall.along) for opening in openings for part in opening.inferred
    ]
    inferred = minus(wall.inferred, [*gaps, *guessed, *wall.drawn])
    return replace(wall, drawn=minus(wall.drawn, gaps), inferred=inferred)


def with_certainty(wall: Footprint, layout: Layout, i: int, frame: PlaneFrame, size: float) -> Footprint:
    """The wall with the band within two σ of its place, or known to be weak; ``size`` is the plan's, world unit."""
    points = wall.at(np.linspace(0.0, wall.length, _BAND_POINTS))
    sigma = layout.planes[i].sigma_offset(frame.to_world(points))
    level = layout.accuracies[i].level if layout.accuracies else 0
    if layout.metric and layout.accuracies:
        weak = level == 0
    else:
        limit = UPPER_ENDS_M[10] if layout.metric else WEAK_SHARE * size
        weak = bool(SIGMAS_95 * sigma.max() > limit)
    if weak or not np.isfinite(sigma).all():
        return replace(wall, weak=True)
    reach = BAND_SIGMAS * sigma[:, None] * wall.inside
    return replace(wall, band=np.concatenate([points + reach, (points - reach)[::-1]]), accuracy_level=level)


def minus(intervals: FloatArray, gaps: Sequence[FloatArray]) -> FloatArray:
    """(N, 2) what is left of (M, 2) intervals without some gaps, (2,) each."""
    left = [(float(a), float(b)) for a, b in intervals]
    for low, high in gaps:
        left = [part for a, b in left for part in ((a, min(b, low)), (max(a, high), b)) if part[0] < part[1]]
    return np.array(left).reshape(-1, 2)


def _union(intervals: Sequence[tuple[float, float]]) -> FloatArray:
    """(N, 2) disjoint, in order."""
    merged: list[list[float]] = []
    for low, high in sorted(intervals):
        if merged and low <= merged[-1][1]:
            merged[-1][1] = max(merged[-1][1], high)
        else:
            merged.append([low, high])
    return np.array(merged).reshape(-1, 2)
