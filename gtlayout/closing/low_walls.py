"""Walls that one looks over: fronts of cupboards, counters, parapets."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from shapely.geometry.base import BaseGeometry

from gtlayout.closing.elevation import Elevation
from gtlayout.closing.plan import Plan, swept
from gtlayout.closing.walls import Wall
from gtlayout.closing_config import ClosingConfig
from gtlayout.layout import Layout


def low_walls(
    layout: Layout,
    plan: Plan,
    walls: Mapping[int, Wall],
    against: Mapping[int, BaseGeometry],
    eyes_height: float,
    depth: float,
    config: ClosingConfig,
) -> frozenset[int]:
    """The ``walls`` that one looks over: lower than the cameras, and key frames show that there is no more wall above.

    ``against`` is the part of each wall's plane, in its frame, where a key frame shows something else. What only
    lies outside all images, or behind a ceiling, is not shown. ``depth`` is the median one.
    """
    found = set()
    for i, wall in walls.items():
        extent = layout.extents[i]
        elevation = Elevation.of(plan, wall, extent.frame)
        seen = elevation.seen(extent.region)
        over = swept(seen, np.array([0.0, config.over_low * depth])).difference(seen)
        shown = over.intersection(elevation.seen(against[i]))
        if seen.bounds[3] < eyes_height and shown.area > config.low_share * over.area:
            found.add(i)
    return frozenset(found)
