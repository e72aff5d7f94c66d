"""Rotations as files hold them: rounded, and sometimes wrong."""

from __future__ import annotations

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.scene import FloatArray

MAX_ROTATION_ERROR = 1e-3
"""|RᵀR - I| up to which a rotation counts as rounded, not wrong."""


def nearest_rotation(matrix: FloatArray, where: str) -> FloatArray:
    """(3, 3) → the rotation next to it.

    Raises GtlayoutError, beginning with ``where``, when it is farther from a rotation than rounding explains.
    """
    off = np.abs(matrix.T @ matrix - np.eye(3)).max()
    if not off <= MAX_ROTATION_ERROR or np.linalg.det(matrix) < 0:
        raise GtlayoutError(f"{where} is no rotation (off by {off:.2g})")
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt, dtype=np.float64)
