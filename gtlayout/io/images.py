"""Pixels of a frame, as its pinhole camera sees them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gtlayout.errors import GtlayoutError
from gtlayout.scene import Frame, ImageArray

MM_PER_UNIT = 1000.0


def read_rgb(frame: Frame) -> ImageArray:
    """(H, W, 3) uint8 RGB, undistorted. Raises GtlayoutError when the file cannot be read or has the wrong size."""
    bgr = _to_camera(decode(frame.image_path, cv2.IMREAD_COLOR), frame, frame.image_path)
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def read_gray(frame: Frame) -> ImageArray:
    """(H, W) uint8, undistorted. Raises GtlayoutError when the file cannot be read or has the wrong size."""
    image = _to_camera(decode(frame.image_path, cv2.IMREAD_GRAYSCALE), frame, frame.image_path)
    return image.astype(np.uint8, copy=False)


def read_depth(frame: Frame) -> npt.NDArray[np.float32]:
    """(H, W) depth along the camera's z in world units (the file's millimetres / 1000), NaN = none.

    Raises GtlayoutError when the frame has no depth map, or it cannot be read, is no 16-bit grey image, or does not
    have the size of the frame's image.
    """
    if frame.depth_path is None:
        raise GtlayoutError(f"frame {frame.name} has no depth map")
    raw = decode(frame.depth_path, cv2.IMREAD_UNCHANGED)
    if raw.dtype != np.uint16 or raw.ndim != 2:
        raise GtlayoutError(f"{frame.depth_path} is no depth map: 16-bit grey is expected")
    depth_mm = _to_camera(raw, frame, frame.depth_path)
    return np.where(depth_mm > 0, depth_mm / np.float32(MM_PER_UNIT), np.float32(np.nan)).astype(np.float32)


def decode(path: Path, mode: int) -> npt.NDArray[Any]:
    """The pixels of an image file, with cv2's ``mode``; rotation hints in EXIF are ignored, as COLMAP does.

    Raises GtlayoutError when the file is missing, empty, cut off or no image.
    """
    try:
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except OSError as error:
        raise GtlayoutError(f"cannot read image {path}: {error.strerror or error}") from error
    if mode != cv2.IMREAD_UNCHANGED:
        mode |= cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(data, mode) if len(data) else None
    except cv2.error:
        image = None
    if image is None:
        raise GtlayoutError(f"cannot read image {path}: damaged, or not an image")
    return image


def _to_camera(image: npt.NDArray[Any], frame: Frame, path: Path) -> npt.NDArray[Any]:
    if frame.undistort is not None:
        try:
            return frame.undistort(image)
        except GtlayoutError as error:
            raise GtlayoutError(f"{path}: {error}") from error
    height, width = image.shape[:2]
    if (width, height) != (frame.camera.width, frame.camera.height):
        raise GtlayoutError(f"{path}: {width}x{height} px, its camera says {frame.camera.width}x{frame.camera.height}")
    return image
