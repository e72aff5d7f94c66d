"""Poses as files hold them: rounded, sometimes wrong, and in other axes. All readers go through ``rigid``."""

from __future__ import annotations

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.scene import FloatArray

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0])
"""Camera axes: OpenGL's are x right, y up, z backward."""
MAX_ROTATION_ERROR = 1e-3
"""|RᵀR - I| up to which a rotation counts as rounded, not wrong. Products of matrices of 32-bit numbers err by 1e-6,
matrices with three decimals by this."""
MAX_LAST_ROW_ERROR = 1e-4
"""What the last row of a 4x4 pose, 0 0 0 1, may be off by rounding."""


def rigid(pose: FloatArray, where: str) -> tuple[FloatArray, FloatArray]:
    """(3, 4) or (4, 4) pose → the (3, 3) rotation next to its left part, and its (3,) right column.

    Raises GtlayoutError, beginning with ``where``, when a number is not finite, the last row is not 0 0 0 1, or the
    left part is mirrored or farther from a rotation than rounding explains.
    """
    if pose.shape not in ((4, 4), (3, 4)) or not np.all(np.isfinite(pose)):
        raise GtlayoutError(f"{where} must be 4x4 (or 3x4) finite numbers")
    off = float(np.abs(pose[3:] - (0, 0, 0, 1)).max(initial=0.0))
    if off > MAX_LAST_ROW_ERROR:
        raise GtlayoutError(f"{where} must end with the row 0 0 0 1 (off by {off:.2g}, more than rounding)")
    return _nearest_rotation(pose[:3, :3], where), np.array(pose[:3, 3])


def _nearest_rotation(matrix: FloatArray, where: str) -> FloatArray:
    # Clipped, lest absurd entries overflow: a rotation's are at most 1.
    clipped = matrix.clip(-10, 10)
    off = float(np.abs(clipped.T @ clipped - np.eye(3)).max())
    if off > MAX_ROTATION_ERROR:
        raise GtlayoutError(f"{where} is no rotation (off by {off:.2g}, rounding explains {MAX_ROTATION_ERROR:g})")
    if np.linalg.det(matrix) < 0:
        raise GtlayoutError(
            f"{where} is mirrored, no rotation (its determinant is -1): one axis, or the order of two, is turned round"
        )
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt, dtype=np.float64)


def cam_from_world_opengl(world_from_cam: FloatArray, where: str) -> tuple[FloatArray, FloatArray]:
    """(3, 4) or (4, 4) camera-to-world with OpenGL's camera axes → rotation and translation of ``cam_from_world``.

    Raises GtlayoutError, beginning with ``where``, as ``rigid`` does.
    """
    rotation, center_world = rigid(world_from_cam, where)
    return cam_from_world(rotation @ OPENGL_FROM_OPENCV, center_world)


def cam_from_world(R_world_from_cam: FloatArray, center_world: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(3, 3) rotation and (3,) translation, from the camera's axes and centre in the world."""
    R_cam_from_world = R_world_from_cam.T
    with np.errstate(over="ignore", invalid="ignore"):  # absurd centres; build_frames refuses what becomes of them
        return R_cam_from_world, -R_cam_from_world @ center_world
