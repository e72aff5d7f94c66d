"""Corners that a person draws as one: the ends of steps of a few pixels, such as where a baseboard ends at a door."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.geometry.raster import rings_of
from gtlayout.scene import Camera, FloatArray

STEP_SHARE = 0.0125
"""Of the image's width: nobody draws shorter edges of trim."""
_BORDER_PX = 1e-3

Corner = tuple[float, float]


def one_corner(regions: Iterable[MultiPolygon], camera: Camera) -> Callable[[FloatArray], FloatArray]:
    """A map of (N, 2) px that moves the ends of short edges of a partition's regions onto one of them.

    The lower one in the image stays, mostly the nearer: so the line on which trim stands on the floor keeps its place.
    Corners on the image border stay as well, and neighbours keep sharing corners.
    """
    reach_px, size = STEP_SHARE * camera.width, np.array([camera.width, camera.height])
    near: dict[Corner, list[Corner]] = defaultdict(list)
    for region in regions:
        for ring in rings_of(region):
            for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                ends = np.stack([start, end])
                inside = (ends > _BORDER_PX).all() and (ends < size - _BORDER_PX).all()
                if inside and 0 < np.linalg.norm(end - start) < reach_px:
                    near[tuple(start.tolist())].append(tuple(end.tolist()))
                    near[tuple(end.tolist())].append(tuple(start.tolist()))
    moved: dict[Corner, Corner] = {}
    for corner in sorted(near, key=lambda corner: (-corner[1], corner[0])):
        if corner not in moved:
            moved |= {other: corner for other in (corner, *near[corner]) if other not in moved}
    return lambda points: np.array([moved.get((x, y), (x, y)) for x, y in points.tolist()]).reshape(-1, 2)


def moved_lines(lines: Iterable[FloatArray], by: Callable[[FloatArray], FloatArray]) -> tuple[FloatArray, ...]:
    """(N, 2) polylines with their corners moved, without those that shrink to a point."""
    found = []
    for line in lines:
        corners = by(line)
        kept = corners[np.r_[True, (np.diff(corners, axis=0) != 0).any(axis=1)]]
        if len(kept) > 1:
            found.append(kept)
    return tuple(found)


def moved_region(region: MultiPolygon, by: Callable[[FloatArray], FloatArray]) -> shapely.Geometry:
    """A region with its corners moved, made valid."""
    return shapely.make_valid(shapely.transform(region, by), method="structure", keep_collapsed=False)
