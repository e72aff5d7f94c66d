"""From pixel masks to polygons."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.scene import BoolArray, FloatArray

SIMPLIFY_PX = 0.25
"""Takes most of the stairs out of slanted lines; pixels hardly ever change sides."""


def mask_polygons(mask: BoolArray) -> MultiPolygon:
    """The region of an (H, W) mask, px, with holes; pixels that touch at a corner only are apart.

    Outlines run between the centres of pixels inside and outside, so that neither side gains by it, and are then
    simplified by up to ``SIMPLIFY_PX``.
    """
    changes = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, start = np.nonzero(changes == 1)
    _, end = np.nonzero(changes == -1)
    pixels = shapely.union_all(shapely.box(start, row, end, row + 1))
    outlines = [
        Polygon(_smoothed(part.exterior), [_smoothed(ring) for ring in part.interiors])
        for part in shapely.get_parts(pixels)
        if isinstance(part, Polygon)
    ]
    simple = shapely.simplify(outlines, SIMPLIFY_PX)
    return MultiPolygon([part for part in simple if isinstance(part, Polygon) and not part.is_empty])


def _smoothed(ring: shapely.LinearRing) -> FloatArray:
    """(N, 2) the middles of a ring's runs along rows and columns, on which slanted lines lie, and its real corners."""
    points = shapely.get_coordinates(ring)[:-1]
    before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    corners = points[before[:, 0] * after[:, 1] != before[:, 1] * after[:, 0]]
    runs = np.roll(corners, -1, axis=0) - corners
    lengths = np.abs(runs).sum(axis=1)
    # The stairs of a line have steps of one pixel; between two longer runs lies a corner.
    real = (lengths > 1) & (np.roll(lengths, 1) > 1)
    both = np.stack([corners, corners + runs / 2], axis=1)
    return np.asarray(both[np.column_stack([real, np.ones_like(real)])], dtype=np.float64)
