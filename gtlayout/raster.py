"""Polygons to pixel masks, with the half-pixel convention settled in one place."""

from __future__ import annotations

import cv2
import numpy as np
from shapely import MultiPolygon

from gtlayout.scene import BoolArray

_SHIFT = 4
"""OpenCV's fixed-point bits for polygon vertices: 1/16 px."""


def polygon_mask(region: MultiPolygon, height: int, width: int) -> BoolArray:
    """(height, width) mask of a region given in pixels ((0, 0) = corner of the first pixel); holes stay empty."""
    mask = np.zeros((height, width), dtype=np.uint8)
    for polygon in region.geoms:
        rings = [polygon.exterior, *polygon.interiors]
        # OpenCV puts (0, 0) at the first pixel's centre. Even-odd filling leaves the holes out.
        corners = [np.round((np.asarray(ring.coords) - 0.5) * (1 << _SHIFT)).astype(np.int32) for ring in rings]
        part = np.zeros_like(mask)
        cv2.fillPoly(part, corners, 1, shift=_SHIFT)
        mask |= part
    return mask.astype(bool)
