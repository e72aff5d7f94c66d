"""Pixels of a frame, as its pinhole camera sees them."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

from gtlayout.errors import GtlayoutError
from gtlayout.io.archives import read_bytes
from gtlayout.io.pixels.heif import SUFFIXES as HEIF_SUFFIXES
from gtlayout.io.pixels.heif import decode_heif, is_heif
from gtlayout.io.pixels.png import SIGNATURE, decode_png, plain_png
from gtlayout.io.pixels.turn import read_header
from gtlayout.limits import IMAGE_MP
from gtlayout.scene import Frame, ImageArray

# What cannot be read is said here, in one line; OpenCV would write several of its own.
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

MM_PER_UNIT = 1000.0
SATURATED = np.iinfo(np.uint16).max
"""What some sensors write where they measured nothing."""
FROM_BGR = {cv2.IMREAD_GRAYSCALE: cv2.COLOR_BGR2GRAY, cv2.IMREAD_COLOR_RGB: cv2.COLOR_BGR2RGB}
TIFF = (b"II*\0", b"MM\0*")
"""How such a file begins."""


def read_rgb(frame: Frame) -> ImageArray:
    """(H, W, 3) uint8 RGB, undistorted. Raises GtlayoutError when the file cannot be read or has the wrong size."""
    return cv2.cvtColor(read_bgr(frame), cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def read_bgr(frame: Frame) -> ImageArray:
    """The same in the order of channels that OpenCV's functions take."""
    return _to_camera(stored_bgr(frame), frame, _source(frame), None).astype(np.uint8, copy=False)


def encoded(suffix: str, image: npt.NDArray[Any], parameters: Sequence[int] = ()) -> bytes:
    """An image file, as OpenCV's ``imencode`` makes it: (H, W) grey, (H, W, 3) BGR or (H, W, 4) BGRA."""
    ok, data = cv2.imencode(suffix, image, list(parameters))
    assert ok, "OpenCV always encodes uint8 and uint16 images"
    return data.tobytes()


def read_gray(frame: Frame) -> ImageArray:
    """(H, W) uint8, undistorted: the same from a JPEG, a PNG of its pixels, and a video.

    Raises GtlayoutError when the file cannot be read or has the wrong size.
    """
    # Not IMREAD_GRAYSCALE: it takes a JPEG's own luminance, which is up to 5 levels off that of its colours.
    image = _to_camera(cv2.cvtColor(stored_bgr(frame), cv2.COLOR_BGR2GRAY), frame, _source(frame), None)
    return image.astype(np.uint8, copy=False)


def read_depth(frame: Frame) -> npt.NDArray[np.float32]:
    """(H, W) depth along the camera's z in world units (the file's millimetres / 1000), NaN = none (0 and 65535).

    Raises GtlayoutError when the frame has no depth map, or it cannot be read, is no 16-bit grey image, or does not
    have the size of its camera.
    """
    if frame.depth_path is None:
        raise GtlayoutError(f"frame {frame.name} has no depth map")
    raw = decode(frame.depth_path, cv2.IMREAD_UNCHANGED)
    if raw.dtype != np.uint16 or raw.ndim != 2:
        raise GtlayoutError(f"{frame.depth_path} is no depth map: 16-bit grey is expected")
    depth_mm = _to_camera(raw, frame, str(frame.depth_path), frame.register_depth)
    measured = (depth_mm > 0) & (depth_mm < SATURATED)
    return np.where(measured, depth_mm / np.float32(MM_PER_UNIT), np.float32(np.nan)).astype(np.float32)


def size_of_first(paths: Iterable[Path]) -> tuple[int, int] | None:
    """(width, height) px of the first image that can be read; None when there is none."""
    for path in paths:
        if path.is_file():
            with suppress(GtlayoutError):
                height, width = decode(path, cv2.IMREAD_UNCHANGED).shape[:2]
                return width, height
    return None


def decode(path: Path, mode: int) -> npt.NDArray[Any]:
    """The pixels of an image file as they are stored, with cv2's ``mode``: its orientation tag is not applied.

    Raises GtlayoutError when the file is missing, empty, cut off or no image.
    """
    content = read_bytes(path, f"cannot read image {path}")
    is_png = content.startswith(SIGNATURE)
    if is_png:
        content = plain_png(content) or b""
    IMAGE_MP.check(_claimed_px(content) / 1e6, f"cannot read image {path}")
    data = np.frombuffer(content, dtype=np.uint8)
    if is_heif(data[:12].tobytes()) or path.suffix.lower() in HEIF_SUFFIXES:
        return _in_mode(decode_heif(path, data.tobytes()), mode)
    try:
        image = decode_png(content) if is_png else _opencv(data, mode)
    except cv2.error:
        image = None
    if image is None:
        raise GtlayoutError(f"cannot read image {path}: damaged, or not an image")
    if is_png:
        return _in_mode(image, mode)
    if data[:4].tobytes() in TIFF and (header := read_header(path)):
        # OpenCV turns these, whatever it is asked for.
        return header.turn.inverse.image(image)
    return image


def _opencv(data: ImageArray, mode: int) -> npt.NDArray[Any] | None:
    ignores = cv2.IMREAD_IGNORE_ORIENTATION if mode != cv2.IMREAD_UNCHANGED else 0
    return cv2.imdecode(data, mode | ignores) if len(data) else None


def _in_mode(stored: npt.NDArray[Any], mode: int) -> npt.NDArray[Any]:
    """What OpenCV makes of grey or BGR pixels in one of its modes."""
    if mode == cv2.IMREAD_UNCHANGED:
        return stored
    as_bytes = (stored >> 8).astype(np.uint8) if stored.dtype == np.uint16 else stored
    bgr = cv2.cvtColor(as_bytes, cv2.COLOR_GRAY2BGR) if as_bytes.ndim == 2 else as_bytes
    return cv2.cvtColor(bgr, FROM_BGR[mode]) if mode in FROM_BGR else bgr


def _claimed_px(content: bytes) -> int:
    """How many pixels an image file says it has, at least; 0 when Pillow cannot tell."""
    with warnings.catch_warnings(), suppress(Exception):  # Pillow raises what its parsers raise.
        warnings.simplefilter("ignore")
        try:
            with Image.open(io.BytesIO(content)) as image:
                return int(image.width * image.height)
        except Image.DecompressionBombError:
            return 2 * (Image.MAX_IMAGE_PIXELS or 0)
    return 0


def stored_bgr(frame: Frame) -> npt.NDArray[Any]:
    """(H, W, 3) uint8 BGR as in the image file or the video, distortion included.

    Raises GtlayoutError when it cannot be read.
    """
    return frame.video.video.frame(frame.video.index) if frame.video else decode(frame.image_path, cv2.IMREAD_COLOR)


def _source(frame: Frame) -> str:
    """What to call the place the pixels come from."""
    return f"{frame.video.video.path}, frame {frame.video.index}" if frame.video else str(frame.image_path)


def _to_camera(
    image: npt.NDArray[Any], frame: Frame, source: str, register: Callable[[npt.NDArray[Any]], npt.NDArray[Any]] | None
) -> npt.NDArray[Any]:
    resample = register or frame.undistort
    if resample is not None:
        try:
            return resample(image)
        except GtlayoutError as error:
            raise GtlayoutError(f"{source}: {error}") from error
    height, width = image.shape[:2]
    if (width, height) != (frame.camera.width, frame.camera.height):
        raise GtlayoutError(
            f"{source}: {width}x{height} px, its camera says {frame.camera.width}x{frame.camera.height}"
        )
    return image
