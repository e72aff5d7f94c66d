"""Outlines of more points than a hand draws are made coarser, so that nothing after them takes minutes or gigabytes.

GEOS needs quadratic time for lines that cross themselves, and its recursion for long ones may end the process.
"""

from __future__ import annotations

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.scene import FloatArray

MAX_POINTS = 20_000
"""Of an outline as it is drawn; a mask of a large image has some thousand."""
MAX_CROSSING = 300
"""Of an outline that crosses itself: repairing it takes up to half a second, and with 1,000 points 14 s."""
MAX_VERTICES = 1_000
"""Of an element when all that is redundant is gone."""
MAX_COARSER = 8.0
"""An outline may move by so many times what it always may; beyond it is another one."""


def few_points(points_px: FloatArray, tolerance_px: float) -> FloatArray | None:
    """(N, 2) → at most ``MAX_POINTS`` of them, so that no other lies farther from a kept one than it may; else None.

    It may lie ``MAX_COARSER`` times the tolerance away, along the line.
    """
    along_px = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_px, axis=0), axis=1))])
    for spacing_px in _steps(tolerance_px):
        if len(points_px) <= MAX_POINTS:
            return points_px
        piece = np.floor(along_px / spacing_px)
        keeps = np.concatenate([[True], np.diff(piece) > 0])
        if np.count_nonzero(keeps) <= MAX_POINTS:
            return points_px[keeps]
    return None


def few_crossings(points_px: FloatArray, tolerance_px: float) -> FloatArray | None:
    """The points of a line that crosses itself, at most ``MAX_CROSSING``, moved as above; None when it has more."""
    line = shapely.linestrings(points_px)
    for allowed_px in _steps(tolerance_px):
        if shapely.get_num_coordinates(line) <= MAX_CROSSING:
            break
        line = shapely.simplify(shapely.linestrings(points_px), allowed_px, preserve_topology=False)
    return shapely.get_coordinates(line) if shapely.get_num_coordinates(line) <= MAX_CROSSING else None


def few_vertices(whole: MultiPolygon, tolerance_px: float) -> MultiPolygon | None:
    """A region of at most ``MAX_VERTICES``, its outline moved as above; None when it has more."""
    for allowed_px in _steps(tolerance_px):
        if shapely.get_num_coordinates(whole) <= MAX_VERTICES:
            return whole
        simpler = shapely.simplify(whole, allowed_px)
        whole = simpler if isinstance(simpler, MultiPolygon) else MultiPolygon([simpler])
    return whole if shapely.get_num_coordinates(whole) <= MAX_VERTICES else None


def _steps(tolerance_px: float) -> FloatArray:
    return tolerance_px * np.geomspace(1.0, MAX_COARSER, 4)
