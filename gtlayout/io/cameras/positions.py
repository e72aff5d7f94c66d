"""Where cameras are: one that is out of all proportion to the others, and positions that lost their digits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtlayout.io.sources import PosedImage
from gtlayout.scene import Camera

FAR = 300.0
"""A camera has a damaged pose when it lies so many times as far from the middle of all as the farthest of the others: a
path of a metre, and a camera 300 m away…"""
MAX_FAR_SHARE = 0.1
"""… and no larger share of them does."""
MIN_STEPS = 1000
"""Positions are coarse when their path is shorter than so many of their steps."""
MAX_OFF = 1e-3
"""A position may be so much of a step off a number of 32 bits: poses are turned in 64."""


def without_far(images: Sequence[PosedImage], most: float) -> tuple[list[PosedImage], list[str]]:
    """The images, without those whose cameras are elsewhere, and a line on these.

    One such pose would set the scale of the scene: nothing else seems to move then. Positions beyond ``most``, which
    are refused elsewhere, are left alone.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        centers = np.array([-i.R_cam_from_world.T @ i.t_cam_from_world for i in images]).reshape(-1, 3)
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
                f"{len(far)} of {len(images)} cameras are elsewhere and were skipped, first "
                f"{images[far[0]].image_path}: {near[-1]:.3g} from the middle of the others, which lie within "
                f"{near[first - 1]:.3g} of it"
            )
            return [image for i, image in enumerate(images) if i not in far], [line]
    return list(images), []


def coarse_positions(cameras: Sequence[Camera]) -> list[str]:
    """A line where numbers of 32 bits, so far from the world's origin, leave a path of steps."""
    for values in (np.array([c.center_world for c in cameras]), np.array([c.t_cam_from_world for c in cameras])):
        path, near = float(np.linalg.norm(np.ptp(values, axis=0))), values.astype(np.float32)
        steps = np.spacing(np.abs(near)).astype(np.float64)
        if 0 < path < MIN_STEPS * steps.max() and (np.abs(values - near) <= MAX_OFF * steps).all():
            return [
                f"camera positions come in steps of {steps.max():.2g}, on a path of {path:.2g}: numbers of 32 bits "
                "hold no more so far from the origin; move the origin into the room before they are written"
            ]
    return []
