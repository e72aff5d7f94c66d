"""Cameras from the intrinsics in files, which are checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.lens import Lens
from gtlayout.io.pixels.registration import Pinhole
from gtlayout.scene import FloatArray

MAX_SIDE_PX = 1 << 16
"""No image is larger (JPEG's limit); a file that states one must not make us allocate it."""
FOCAL_SHARES = (1e-3, 1e3)
"""Of the image's longer side: from any fisheye to any telescope."""
MAX_PARAMETER = 1e9
"""Distortion coefficients; beyond it, a number is damage."""
MAX_STRETCH = 0.01
"""Images may come in another size than their cameras say, but not in another shape."""
MAX_OFF_CENTRE = 0.2
"""Share of the side by which a principal point is off the image's centre without a doubt: lenses and sensors are built
to 1 or 2 %, structure from motion errs by 5 %, and what is farther off is cropped or of images of another size."""
SAME_SHARE = 0.1
"""A principal point lies at the same share of both sides, as in an image of another size, when so much is between
them: twice the error of structure from motion."""
DOUBTED_SIZE, OTHER_SIZE = 1.1, 1.5
"""From this ratio of sizes on, to either side, intrinsics are doubted to be of images of this size; and are not."""


def finite(value: Any) -> float | None:
    """What JSON may hold, as a float; None when it is no number, not finite, or a truth value."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def lens(
    model: str, size: tuple[float, float], params: Sequence[float], where: str, *, size_is_stated: bool = True
) -> Lens:
    """COLMAP's camera ``model`` for images of ``size`` (width, height) px, pixel centres at +0.5.

    ``size_is_stated``: whether the file says for what size it is; where it does not, ``size`` is that of the images.
    Raises GtlayoutError, beginning with ``where``, when the size, a focal length or another parameter cannot be one, or
    the principal point says that the camera is for images of another size.
    """
    if not all(2 <= side <= MAX_SIDE_PX and side % 1 == 0 for side in size):
        raise GtlayoutError(f"{where}: an image of {size[0]:g}x{size[1]:g} px is none (whole numbers from 2 on)")
    camera = Lens(model, int(size[0]), int(size[1]), tuple(float(value) for value in params))
    check_lens(camera, where)
    if not size_is_stated and (ratio := _other_size(camera)) and not 1 / OTHER_SIZE < ratio < OTHER_SIZE:
        raise GtlayoutError(f"{where}: {_of_another_size(camera, ratio)}; {_MEND}")
    return camera


def check_lens(camera: Lens, where: str) -> None:
    """Raises GtlayoutError, beginning with ``where``, for a camera that cannot be one."""
    width, height = camera.width, camera.height
    if not 2 <= min(width, height) <= max(width, height) <= MAX_SIDE_PX:
        raise GtlayoutError(f"{where} has no valid size and focal length")
    shares = camera.focal_px / max(width, height)
    focals = np.all((shares >= FOCAL_SHARES[0]) & (shares <= FOCAL_SHARES[1]))
    if not focals or not np.all(np.abs(camera.params) <= MAX_PARAMETER):
        raise GtlayoutError(f"{where} has no valid size and focal length")
    if len(camera.principal_px) and not np.all(np.abs(_centre_shares(camera) - 1) <= 1):
        raise GtlayoutError(f"{where}: {_of_another_size(camera, _other_size(camera))}; {_MEND}")


def doubt(camera: Lens) -> str | None:
    """Why a valid camera may not be that of its images, though it may be: its principal point is far off their centre.

    A clause about *the principal point*; None without a doubt.
    """
    if not len(camera.principal_px):
        return None
    ratio = _other_size(camera)
    resized = ratio is not None and not 1 / DOUBTED_SIZE < ratio < DOUBTED_SIZE
    if resized or np.any(np.abs(_centre_shares(camera) - 1) > 2 * MAX_OFF_CENTRE):
        return f"{_of_another_size(camera, ratio if resized else None)}, or they were cropped"
    return None


def scaled(camera: Lens, size: tuple[int, int], where: str) -> Lens:
    """The same lens for images of another ``size`` (width, height) px and the same shape.

    Raises GtlayoutError, beginning with ``where``, when the shape differs.
    """
    x, y = size[0] / camera.width, size[1] / camera.height
    if abs(x / y - 1) > MAX_STRETCH:
        raise GtlayoutError(
            f"{where} is for images of {camera.width}x{camera.height} px, but this one is {size[0]}x{size[1]}, "
            "another shape: scale one to the other"
        )
    return camera.rescaled(*size)


def pinhole(camera: Lens) -> Pinhole:
    """The same camera as depth maps have it."""
    return Pinhole(camera.K, camera.width, camera.height)


_MEND = "scale them to these images, or take the images they were calibrated on"


def _centre_shares(camera: Lens) -> FloatArray:
    """(2,) principal point in halves of width and height: 1 is the centre, 0 and 2 the border."""
    return 2 * camera.principal_px / (camera.width, camera.height)


def _other_size(camera: Lens) -> float | None:
    """How many times as large the images would be that have the principal point in their centre; None where these would
    have another shape.
    """
    x, y = _centre_shares(camera)
    return float((x + y) / 2) if min(x, y) > 0 and abs(x - y) <= SAME_SHARE * y else None


def _of_another_size(camera: Lens, ratio: float | None) -> str:
    x, y = camera.principal_px
    inside = 0 <= x <= camera.width and 0 <= y <= camera.height
    place = "far off the centre of" if inside else "outside of"
    size = f"{camera.width}x{camera.height} px"
    of = f": the intrinsics seem to be for images of about {2 * x:.0f}x{2 * y:.0f} px" if ratio else ""
    return f"the principal point ({x:.6g}, {y:.6g}) lies {place} images of {size}{of}"
