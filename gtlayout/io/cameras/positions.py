"""Where cameras are: one that is out of all proportion to the others, and positions that lost their digits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtlayout.io.sources import PosedImage
from gtlayout.scene import FloatArray

FAR = 300.0
"""A camera has a damaged pose when it lies so many times as far from the middle of all as the farthest of the others: a
path of a metre, and a camera 300 m away…"""
MAX_FAR_SHARE = 0.1
"""… and no larger share of them does."""
MIN_STEPS = 1000
"""Positions are coarse when their path is shorter than so many of their steps."""
MAX_OFF = 1e-3
"""A difference may be so much of a step off a whole number of them: poses are turned and scaled in 64 bits."""
SINGLE_PRECISION = (2.0**-25, 2.0**-20)
"""The step between two numbers of 32 bits as a share of them; twice as much where few numbers show it."""


def without_far(images: Sequence[PosedImage], most: float) -> tuple[list[PosedImage], list[str]]:
    """The images, without those whose cameras are elsewhere, and a line on these.

    One such pose would set the scale of the scene: nothing else seems to move then. Positions beyond ``most``, which
    are refused elsewhere, are left alone.
    """
    centers = np.array([_center(image) for image in images]).reshape(-1, 3)
    known = np.flatnonzero((np.abs(centers) <= most).all(axis=1))
    if len(known) < 4:
        return list(images), []
    distances = np.linalg.norm(centers[known] - np.median(centers[known], axis=0), axis=1)
    order = np.argsort(distances, kind="stable")
    near = distances[order]
    for first in range(len(order) - max(1, int(MAX_FAR_SHARE * len(order))), len(order)):
        if 0 < near[first - 1] < near[first] / FAR:
            far = sorted(known[order[first:]].tolist())
            line = (
                f"{len(far)} of {len(images)} cameras are elsewhere and were skipped, first {images[far[0]].image_path}: "
                f"{near[-1]:.3g} from the middle of the others, which lie within {near[first - 1]:.3g} of it"
            )
            return [image for i, image in enumerate(images) if i not in far], [line]
    return list(images), []


def coarse_positions(images: Sequence[PosedImage]) -> list[str]:
    """A line where numbers of 32 bits, so far from the world's origin, leave a path of steps."""
    for values in (np.array([_center(image) for image in images]), np.array([i.t_cam_from_world for i in images])):
        for axis in values.T:
            step = _step(axis)
            low, high = (share * float(np.abs(axis).max()) for share in SINGLE_PRECISION)
            if low <= step <= high and np.ptp(axis) < MIN_STEPS * step:
                return [
                    f"camera positions come in steps of {step:.2g}, on a path of {np.ptp(axis):.2g}: numbers of 32 bits "
                    "hold no more so far from the origin; move the origin into the room before they are written"
                ]
    return []


def _center(image: PosedImage) -> FloatArray:
    return -image.R_cam_from_world.T @ image.t_cam_from_world


def _step(values: FloatArray) -> float:
    """The largest number that all differences of (N,) values are multiples of; 0 where there is none to be seen."""
    apart = np.diff(np.sort(values))
    rounding = 1e-12 * float(np.abs(values).max())
    apart = apart[apart > rounding]
    if len(apart) < 3:
        return 0.0
    step = float(apart.min())
    return step if np.abs(apart / step - np.round(apart / step)).max() < MAX_OFF else 0.0
