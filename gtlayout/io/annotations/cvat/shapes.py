"""The shapes of CVAT's XML: from a node's attributes to outlines and lines, px.

Coordinates have (0, 0) at the top-left corner of the first pixel: CVAT clamps vertices to 0 … width and 0 … height
(``fitPoints`` in ``cvat-core``; 1920, not 1919: its issue 9973). Masks are whole pixels.
"""

from __future__ import annotations

import re
from xml.etree.ElementTree import Element as Node

import numpy as np
import numpy.typing as npt
import shapely

from gtlayout.io.annotations.checked import MAX_PX, UnusableError
from gtlayout.io.annotations.masks import mask_polygons, simple_rings
from gtlayout.scene import BoolArray, FloatArray

MAX_MASK_PX = 1 << 26
"""Larger than any camera's image; a mask is unpacked into that many bytes."""
LEAST_POINTS = {"polygon": 3, "polyline": 2}


def geometry(node: Node) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """Polygons and polylines; raises ValueError, TypeError, OverflowError or UnusableError."""
    if node.tag == "box":
        return (_box(node),), ()
    if node.tag == "mask":
        return _mask(node), ()
    if node.tag not in LEAST_POINTS:
        raise UnusableError("it is no polygon, polyline, box or mask")
    points_px = _px([[float(x), float(y)] for x, y in (pair.split(",") for pair in node.get("points", "").split(";"))])
    if len(points_px) < LEAST_POINTS[node.tag]:
        raise UnusableError(f"it has fewer than {LEAST_POINTS[node.tag]} points")
    return ((points_px,), ()) if node.tag == "polygon" else ((), (points_px,))


def _px(points: npt.ArrayLike) -> FloatArray:
    points_px = np.array(points, dtype=np.float64)
    if not np.all(np.abs(points_px) <= MAX_PX):
        raise ValueError
    return points_px


def _box(node: Node) -> FloatArray:
    """(4, 2) corners; ``rotation`` is in degrees, clockwise as seen, about the middle."""
    low, high = _px([[float(node.get(f"{axis}{end}", "")) for axis in "xy"] for end in ("tl", "br")])
    angle = np.radians(float(node.get("rotation", 0)) % 360)
    cos, sin = np.cos(angle), np.sin(angle)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (high - low) / 2
    return _px((low + high) / 2 + corners @ np.array([[cos, sin], [-sin, cos]]))


def _mask(node: Node) -> tuple[FloatArray, ...]:
    """Outlines of a mask's pixels. Its runs go along the rows of the crop, pixels outside first."""
    left, top, width, height = (whole_number(node.get(key)) for key in ("left", "top", "width", "height"))
    if left is None or top is None or not width or not height:
        raise ValueError
    if width * height > MAX_MASK_PX:
        raise UnusableError("it has more than 2^26 pixels")
    runs = np.array([int(run) for run in node.get("rle", "").split(",")], dtype=np.int64)
    if np.any((runs < 0) | (runs > MAX_MASK_PX)) or runs.sum() != width * height:
        raise UnusableError("its runs do not add up to its size")
    inside: BoolArray = np.repeat(np.arange(len(runs)) % 2 == 1, runs).reshape(height, width)
    return tuple(
        simple_rings(shapely.transform(mask_polygons(inside), lambda points_px: points_px + np.array([left, top])))
    )


def whole_number(text: str | None) -> int | None:
    """A number that counts frames or pixels; None when it is none, or a slip."""
    return int(text) if text and re.fullmatch(r"\s*\d{1,6}\s*", text, re.ASCII) else None
