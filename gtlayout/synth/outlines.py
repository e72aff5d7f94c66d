"""Outlines of synthetic rooms seen from above: crooked, skew, drawn in (metres)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely import Polygon

from gtlayout.scene import FloatArray

CROOKED_M = 0.05
SKEW_DEG = 6.0
"""Walls of a ``polygon`` room are at least so far from parallel and from square to each other."""
MIN_DENT_DEG = 25.0
"""A corner of it that points inwards does so by that much."""


def crooked(corners: Sequence[tuple[float, float]], rng: np.random.Generator) -> FloatArray:
    """(N, 2) corners, each off by up to ``CROOKED_M``."""
    outline = np.array(corners, float)
    return outline + rng.uniform(-CROOKED_M, CROOKED_M, outline.shape)


def skew_outline(rng: np.random.Generator) -> FloatArray:
    """(5 or 6, 2) counter-clockwise corners, first tried, then looked at."""
    dented = rng.uniform() < 0.4
    radii_m = np.array([3.1, 3.3] if dented else [2.7, 2.9])
    while True:
        count = int(rng.integers(5, 7))
        angle = 2 * np.pi * (np.arange(count) + rng.uniform(-0.22, 0.22, count) + rng.uniform()) / count
        outline = rng.uniform(0.85, 1.15, (count, 1)) * radii_m * np.column_stack([np.cos(angle), np.sin(angle)])
        if dented:
            # The farthest corner: the near end is for cameras.
            outline[np.argmax(outline[:, 1])] *= 0.25
        sides = np.roll(outline, -1, axis=0) - outline
        turn_deg = np.rad2deg(np.arctan2(*_cross_dot(np.roll(sides, 1, axis=0), sides)))
        direction_deg = np.rad2deg(np.arctan2(sides[:, 1], sides[:, 0]))
        between = np.abs(direction_deg[:, None] - direction_deg)[np.triu_indices(count, 1)]
        off_right_angle_deg = np.abs((between + 45) % 90 - 45).min()
        area = Polygon(outline).area
        if (
            off_right_angle_deg > SKEW_DEG
            and np.linalg.norm(sides, axis=1).min() > 1.4
            and np.abs(turn_deg).max() < 110
            and (turn_deg.min() < -MIN_DENT_DEG if dented else turn_deg.min() > 0)
            and 12 < area < 22
        ):
            return outline - outline.min(axis=0)


def _cross_dot(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)


def inset(outline: FloatArray, moved: Sequence[bool], by_m: float) -> FloatArray:
    """(N, 2) outline with some of its sides moved inwards."""
    sides = np.roll(outline, -1, axis=0) - outline
    inwards = np.column_stack([-sides[:, 1], sides[:, 0]]) / np.linalg.norm(sides, axis=1)[:, None]
    offset = (inwards * outline).sum(axis=1) + by_m * np.array(moved)
    return np.stack(
        [np.linalg.solve(inwards[[side - 1, side]], offset[[side - 1, side]]) for side in range(len(outline))]
    )
