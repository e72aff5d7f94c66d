"""Poses as files hold them: rounded, sometimes wrong, and in other axes."""

from __future__ import annotations

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.scene import FloatArray

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0])
"""Camera axes: OpenGL's are x right, y up, z backward."""
MAX_ROTATION_ERROR = 1e-3
"""|RᵀR - I| up to which a rotation counts as rounded, not wrong."""


def nearest_rotation(matrix: FloatArray, where: str) -> FloatArray:
    """(3, 3) → the rotation next to it.

    Raises GtlayoutError, beginning with ``where``, when it is farther from a rotation than rounding explains.
    """
    # Clipped, lest absurd entries overflow: a rotation's are at most 1.
    clipped = matrix.clip(-10, 10)
    off = np.abs(clipped.T @ clipped - np.eye(3)).max()
    if not off <= MAX_ROTATION_ERROR or np.linalg.det(matrix) < 0:
        raise GtlayoutError(f"{where} is no rotation (off by {off:.2g})")
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt, dtype=np.float64)


def cam_from_world_opengl(world_from_cam: FloatArray, where: str) -> tuple[FloatArray, FloatArray]:
    """(3, 4) or (4, 4) camera-to-world with OpenGL's camera axes → rotation and translation of ``cam_from_world``.

    Raises GtlayoutError, beginning with ``where``, when its left 3x3 is no rotation.
    """
    rotation = nearest_rotation(world_from_cam[:3, :3], where)
    return cam_from_world(rotation @ OPENGL_FROM_OPENCV, world_from_cam[:3, 3])


def cam_from_world(R_world_from_cam: FloatArray, center_world: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(3, 3) rotation and (3,) translation, from the camera's axes and centre in the world."""
    R_cam_from_world = R_world_from_cam.T
    with np.errstate(over="ignore", invalid="ignore"):  # absurd centres; build_frames refuses what becomes of them
        return R_cam_from_world, -R_cam_from_world @ center_world
