"""RealEstate10k camera files: the cameras of one clip of a real-estate video, without its images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.poses import nearest_rotation
from gtlayout.scene import FloatArray

COLUMNS = 19
"""Timestamp, fx fy cx cy, two zeros, the 3x4 matrix row by row."""


@dataclass(frozen=True)
class Re10kCamera:
    """One line of the file."""

    timestamp_us: int
    """Within the video."""
    focal_shares: tuple[float, float]
    """fx and fy as shares of the image's width and height."""
    center_shares: tuple[float, float]
    """cx and cy, likewise, from the image's top-left corner."""
    R_cam_from_world: FloatArray
    """(3, 3) rotation."""
    t_cam_from_world: FloatArray
    """(3,) translation, in a unit that is the clip's own."""


def read_cameras(path: Path) -> tuple[Re10kCamera, ...]:
    """Read the file; its cameras come in order of their timestamps, and rotations are made orthonormal.

    The first line, the video's address, is not kept. Raises GtlayoutError naming the file and the line for whatever
    is missing, not a finite number, not a rotation, or out of order.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise GtlayoutError(f"cannot read {path}: {error.strerror or error}") from error
    except ValueError as error:
        raise GtlayoutError(f"{path} is not a text file") from error
    if not lines or "://" not in lines[0]:
        raise GtlayoutError(f"{path}, line 1 must be the address of the video")
    cameras: list[Re10kCamera] = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        cameras.append(_camera(line, where))
        if len(cameras) > 1 and cameras[-1].timestamp_us <= cameras[-2].timestamp_us:
            raise GtlayoutError(f"{where}: the timestamp is not later than the one before")
    if not cameras:
        raise GtlayoutError(f"{path} holds no camera")
    return tuple(cameras)


def _camera(line: str, where: str) -> Re10kCamera:
    words = line.split()
    if len(words) != COLUMNS:
        raise GtlayoutError(f"{where} has {len(words)} columns, {COLUMNS} are expected")
    try:
        timestamp_us, values = int(words[0]), np.array([float(word) for word in words[1:]])
    except ValueError as error:
        raise GtlayoutError(f"{where}: not a number: {str(error).rpartition(': ')[2]}") from error
    if not np.all(np.isfinite(values)):
        raise GtlayoutError(f"{where}: all columns must be finite numbers")
    fx, fy, cx, cy = (float(value) for value in values[:4])
    if min(fx, fy) <= 0:
        raise GtlayoutError(f"{where}: the focal lengths (columns 2 and 3) must be positive")
    cam_from_world = values[6:].reshape(3, 4)
    rotation = nearest_rotation(cam_from_world[:, :3], f"{where}: what columns 8 to 18 hold")
    return Re10kCamera(timestamp_us, (fx, fy), (cx, cy), rotation, cam_from_world[:, 3])
