"""Parts of a key frame as the page shows them: a window on the photo that it has once, with lines over it."""

from __future__ import annotations

import math

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from gtlayout.scene import Camera, FloatArray

ASPECT = 4 / 3
"""Width by height of every window."""
_MARGIN = 0.12
"""Of what is shown, on each side."""
_LEAST = 0.35
"""Of the image's width: less shows no context."""


def window(camera: Camera, shown: BaseGeometry) -> str:
    """The ``viewBox`` of an SVG that holds what is shown, px of the image; the whole image where nothing is."""
    visible = shown.intersection(shapely.box(0, 0, camera.width, camera.height))
    if visible.is_empty:
        return f"0 0 {camera.width} {camera.height}"
    left, top, right, bottom = visible.bounds
    width = max((1 + 2 * _MARGIN) * max(right - left, ASPECT * (bottom - top)), _LEAST * camera.width)
    width = min(width, max(camera.width, ASPECT * camera.height))
    height = width / ASPECT
    x, y = (left + right - width) / 2, (top + bottom - height) / 2
    x, y = _inside(x, width, camera.width), _inside(y, height, camera.height)
    return f"{x:.0f} {y:.0f} {width:.0f} {height:.0f}"


def dots(points_px: FloatArray) -> str:
    """An SVG path of a dot at each of (N, 2) points: strokes of no length with round ends."""
    return "".join(f"M{x:.0f} {y:.0f}h0" for x, y in points_px)


def line(points_px: FloatArray) -> str:
    """The ``points`` of an SVG polyline."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points_px if math.isfinite(x) and math.isfinite(y))


def _inside(start: float, length: float, whole: float) -> float:
    """A window moved into the image, or its middle on the image's where it is the larger."""
    return float(np.clip(start, 0, whole - length)) if length < whole else (whole - length) / 2
