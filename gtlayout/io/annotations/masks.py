"""From pixel masks to polygons."""

from __future__ import annotations

import struct
from collections.abc import Iterable

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.io.pixels.png import decode_png, plain_png
from gtlayout.scene import BoolArray, FloatArray, ImageArray, IntArray

SIMPLIFY_PX = 0.25
"""Takes most of the stairs out of slanted lines; pixels hardly ever change sides."""
MAX_RUNS = 500_000
"""Nothing that was drawn has so many; they would take gigabytes."""
PNG_HEAD = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"
MAX_MASK_PX = 1 << 26
"""Larger than any camera's image; a mask is unpacked into that many bytes, whatever the file's size."""


def decode_mask(png: bytes) -> ImageArray:
    """(H, W) grey values of a PNG file's content; raises ValueError, with words to follow its name."""
    if not png.startswith(PNG_HEAD) or len(png) < len(PNG_HEAD) + 8:
        raise ValueError("is no PNG image")
    width, height = struct.unpack_from(">II", png, len(PNG_HEAD))
    if width * height > MAX_MASK_PX:
        raise ValueError(f"claims to have more than {MAX_MASK_PX} pixels")
    plain = plain_png(png)
    mask = decode_png(plain) if plain is not None else None
    if mask is None:
        raise ValueError("is a damaged image")
    if mask.ndim != 2 or mask.max() > np.iinfo(np.uint8).max:
        raise ValueError("is no mask: 8-bit grey is expected")
    return mask.astype(np.uint8)


def mask_polygons(mask: BoolArray) -> MultiPolygon:
    """The region of an (H, W) mask, px, with holes; pixels that touch at a corner only are apart.

    Outlines run between the centres of pixels inside and outside, so that neither side gains by it, and are then
    simplified by up to ``SIMPLIFY_PX``. Raises ValueError, with words to follow the mask's name, when it has more than
    ``MAX_RUNS`` runs.
    """
    padded = np.pad(mask, ((0, 0), (1, 1)))
    starts = padded[:, 1:] & ~padded[:, :-1]
    _refuse_noise(int(np.count_nonzero(starts)))
    row, start = np.nonzero(starts)
    _, end = np.nonzero(padded[:, :-1] & ~padded[:, 1:])
    return boxes_polygons(np.column_stack([start, row, end, row + 1]))


def boxes_polygons(boxes: IntArray) -> MultiPolygon:
    """The region that (N, 4) boxes x0 y0 x1 y1 of whole pixels make up, with outlines likewise.

    They must not overlap. Raises ValueError as ``mask_polygons`` does.
    """
    _refuse_noise(len(boxes))
    pixels = shapely.union_all(shapely.box(*boxes.T))
    outlines = [
        Polygon(_smoothed(part.exterior), [_smoothed(ring) for ring in part.interiors])
        for part in shapely.get_parts(pixels)
        if isinstance(part, Polygon)
    ]
    simple = shapely.simplify(outlines, SIMPLIFY_PX)
    return MultiPolygon([part for part in simple if isinstance(part, Polygon) and not part.is_empty])


def _refuse_noise(runs: int) -> None:
    if runs > MAX_RUNS:
        raise ValueError(f"has more than {MAX_RUNS} runs of pixels: that is noise, nothing drawn")


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


def simple_rings(region: MultiPolygon) -> list[FloatArray]:
    """(N, 2) outer rings, without the closing point, of pieces without holes that make up the region."""
    pieces = [piece for polygon in region.geoms for piece in _without_holes(polygon)]
    return [np.array(piece.exterior.coords)[:-1] for piece in pieces]


def _without_holes(polygon: Polygon) -> Iterable[Polygon]:
    """Cut from top to bottom through the middle one of the holes, from left to right, until none is left."""
    if not polygon.interiors:
        return [polygon]
    x_min, y_min, x_max, y_max = polygon.bounds
    x_cut = sorted(hole.centroid.x for hole in polygon.interiors)[len(polygon.interiors) // 2]
    halves = (polygon & shapely.box(x_min, y_min, x_cut, y_max), polygon & shapely.box(x_cut, y_min, x_max, y_max))
    parts = [part for half in halves for part in shapely.get_parts(half) if isinstance(part, Polygon)]
    return [piece for part in parts for piece in _without_holes(part)]
