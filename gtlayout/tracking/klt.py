"""Stage 1: a point from one image to the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from gtlayout.scene import BoolArray, FloatArray, ImageArray

_GRID_PER_PX = 1024.0
"""Steps per pixel of the positions given to OpenCV: exact in its 32 bits, a hundredth of its precision."""


class PairTracker(Protocol):
    """Moves points from one image to the next. KLT below; any dense flow (RAFT …) fits as well."""

    def __call__(
        self, source: ImageArray, target: ImageArray, points_px: FloatArray, guess_px: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Find (N, 2) ``points_px`` of ``source`` in ``target``, near ``guess_px``.

        Returns their positions and whether each passed the tracker's own forward-backward check.
        """
        ...


@dataclass(frozen=True)
class KltTracker:
    """Pyramidal Lucas-Kanade with forward-backward check."""

    window_px: int
    levels: int
    max_forward_backward_px: float

    def __call__(
        self, source: ImageArray, target: ImageArray, points_px: FloatArray, guess_px: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """See ``PairTracker``."""
        moved, found = lucas_kanade(source, target, points_px, guess_px, self.window_px, self.levels)
        back, found_back = lucas_kanade(target, source, moved[found], points_px[found], self.window_px, self.levels)
        close = np.linalg.norm(back - points_px[found], axis=1) < self.max_forward_backward_px
        found[found] = found_back & close
        return moved, found


def lucas_kanade(
    source: ImageArray, target: ImageArray, points_px: FloatArray, guess_px: FloatArray, window_px: int, levels: int
) -> tuple[FloatArray, BoolArray]:
    """(N, 2) where points of ``source`` are in ``target``, looked for from ``guess_px`` on, and whether each was found.

    Pixels are the project's, with (0, 0) at the image's corner.
    """
    if len(points_px) == 0:
        return np.empty((0, 2)), np.empty(0, dtype=bool)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        source,
        target,
        _opencv_points(points_px),
        _opencv_points(guess_px),
        winSize=(window_px, window_px),
        maxLevel=levels,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    moved_px = moved[:, 0].astype(np.float64) + 0.5
    return moved_px, (status[:, 0] == 1) & np.isfinite(moved_px).all(axis=1)


def _opencv_points(points_px: FloatArray) -> npt.NDArray[np.float32]:
    """OpenCV's shape and its convention of (0, 0) at the first pixel's centre.

    On a grid: last digits of the cameras, which differ between worlds and machines, must not move a match.
    """
    on_grid = np.round((points_px - 0.5) * _GRID_PER_PX) / _GRID_PER_PX
    return np.ascontiguousarray(on_grid, dtype=np.float32).reshape(-1, 1, 2)
