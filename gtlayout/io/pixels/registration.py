"""Depth maps with a camera of their own, seen through the camera of the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gtlayout.errors import GtlayoutError
from gtlayout.scene import FloatArray

DepthMap = npt.NDArray[np.uint16]
ONE_SURFACE = 0.02
"""Depths of neighbouring pixels that differ by a smaller share belong together: a floor ten metres away still
does."""


@dataclass(frozen=True)
class Pinhole:
    """Size and intrinsics of an image without distortion and skew."""

    K: FloatArray
    """(3, 3) intrinsics, px; pixel centres at +0.5."""
    width: int
    height: int


@dataclass(frozen=True)
class Registration:
    """From one pinhole image to another from the same place in the same direction; a depth along z stays as it is."""

    source: Pinhole
    target: Pinhole

    def __call__(self, depth: DepthMap) -> DepthMap:
        """(H, W) of the source → (H, W) of the target, 0 where the source does not reach.

        Between four pixels of one surface the inverse depth is interpolated, which is exact on planes; elsewhere the
        nearest pixel is taken, since a mean over a depth edge would be a depth that does not exist.
        Raises GtlayoutError on another size.
        """
        source, target = self.source, self.target
        if depth.shape != (source.height, source.width):
            height, width = depth.shape[:2]
            raise GtlayoutError(f"{width}x{height} px, its camera says {source.width}x{source.height}")
        x, y = self._source_px(0, target.width), self._source_px(1, target.height)
        inside = ((y >= 0) & (y < source.height))[:, None] & ((x >= 0) & (x < source.width))
        nearest = _pick(depth, np.floor(y), np.floor(x))
        # From here on in steps between pixel centres.
        x, y = x - 0.5, y - 0.5
        left, top = np.floor(x), np.floor(y)
        corners = np.stack([_pick(depth, top + i, left + j) for i in (0, 1) for j in (0, 1)])
        one_surface = (corners.min(axis=0) > 0) & (corners.max(axis=0) <= (1 + ONE_SURFACE) * corners.min(axis=0))
        inverse = 1 / np.where(one_surface, corners, 1.0)
        share_x, share_y = x - left, (y - top)[:, None]
        upper, lower = (inverse[k] + share_x * (inverse[k + 1] - inverse[k]) for k in (0, 2))
        between = 1 / (upper + share_y * (lower - upper))
        return np.where(inside, np.where(one_surface, np.rint(between), nearest), 0).astype(depth.dtype)

    def _source_px(self, axis: int, count: int) -> FloatArray:
        """Where each of the target's columns (or rows) lies in the source, px."""
        slope = (np.arange(count) + 0.5 - self.target.K[axis, 2]) / self.target.K[axis, axis]
        return np.asarray(slope * self.source.K[axis, axis] + self.source.K[axis, 2], dtype=np.float64)


def _pick(depth: DepthMap, rows: FloatArray, columns: FloatArray) -> FloatArray:
    """(len(rows), len(columns)) depths, those at the border for what lies beyond it."""
    height, width = depth.shape
    inside = (np.clip(rows, 0, height - 1).astype(np.int64), np.clip(columns, 0, width - 1).astype(np.int64))
    return depth[np.ix_(*inside)].astype(np.float64)
