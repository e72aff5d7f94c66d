"""Cameras from the intrinsics in files, which are checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pycolmap

from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.registration import Pinhole

MAX_SIDE_PX = 1 << 16
"""No image is larger (JPEG's limit); a file that states one must not make us allocate it."""
FOCAL_SHARES = (1e-3, 1e3)
"""Of the image's longer side: from any fisheye to any telescope."""
MAX_PARAMETER = 1e9
"""Principal points and distortion coefficients; beyond it, a number is damage."""
MAX_STRETCH = 0.01
"""Images may come in another size than their cameras say, but not in another shape."""


def finite(value: Any) -> float | None:
    """What JSON may hold, as a float; None when it is no number, not finite, or a truth value."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def lens(model: str, size: tuple[float, float], params: Sequence[float], where: str) -> pycolmap.Camera:
    """COLMAP's camera ``model`` for images of ``size`` (width, height) px, pixel centres at +0.5.

    Raises GtlayoutError, beginning with ``where``, when the size, a focal length or another parameter cannot be one.
    """
    if not all(2 <= side <= MAX_SIDE_PX and side % 1 == 0 for side in size):
        raise GtlayoutError(f"{where}: an image of {size[0]:g}x{size[1]:g} px is none (whole numbers from 2 on)")
    camera = pycolmap.Camera(model=model, width=int(size[0]), height=int(size[1]), params=list(params))
    check_lens(camera, where)
    return camera


def check_lens(camera: pycolmap.Camera, where: str) -> None:
    """Raises GtlayoutError, beginning with ``where``, for a camera that cannot be one."""
    width, height = camera.width, camera.height
    sizes = min(width, height) >= 2 and max(width, height) <= MAX_SIDE_PX
    shares = camera.params[camera.focal_length_idxs()] / max(width, height, 1)
    focals = np.all((shares >= FOCAL_SHARES[0]) & (shares <= FOCAL_SHARES[1]))
    if not sizes or not focals or not np.all(np.abs(camera.params) <= MAX_PARAMETER):
        raise GtlayoutError(f"{where} has no valid size and focal length")


def scaled(camera: pycolmap.Camera, size: tuple[int, int], where: str) -> pycolmap.Camera:
    """A PINHOLE camera for images of another ``size`` (width, height) px and the same shape.

    Raises GtlayoutError, beginning with ``where``, when the shape differs.
    """
    x, y = size[0] / camera.width, size[1] / camera.height
    if abs(x / y - 1) > MAX_STRETCH:
        raise GtlayoutError(
            f"{where} is for images of {camera.width}x{camera.height} px, but this one is {size[0]}x{size[1]}"
        )
    return lens("PINHOLE", size, [float(p) for p in camera.params * (x, y, x, y)], where)


def pinhole(camera: pycolmap.Camera) -> Pinhole:
    """The same camera as depth maps have it."""
    return Pinhole(np.array(camera.calibration_matrix(), dtype=np.float64), int(camera.width), int(camera.height))
