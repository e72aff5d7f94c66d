"""The interface between NumPy residual functions and ``gtsam.CustomFactor``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gtsam
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Residual = Callable[[gtsam.Values, bool], tuple[FloatArray, list[FloatArray]]]
"""(values, want_jacobians) → ((m,) residual, one (m, tangent dimension) Jacobian per key, or [] when not wanted)."""


def custom_factor(noise: Any, keys: Sequence[int], residual: Residual) -> gtsam.CustomFactor:
    """A custom factor whose shapes are checked once, when it is made, not by GTSAM in the middle of a solve.

    Raises:
        ValueError: at the first evaluation, when the residual or a Jacobian does not fit ``noise`` and ``keys``.
    """
    dimension = noise.dim()
    checked = False

    def evaluate(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        nonlocal checked
        error, blocks = residual(values, jacobians is not None)
        if jacobians is not None:
            if not checked:
                _check_shapes(dimension, len(keys), error, blocks)
                checked = True
            for i, block in enumerate(blocks):
                jacobians[i] = block
        return error

    return gtsam.CustomFactor(noise, list(keys), evaluate)


def _check_shapes(dimension: int, keys: int, error: FloatArray, blocks: list[FloatArray]) -> None:
    if error.shape != (dimension,):
        raise ValueError(f"residual has shape {error.shape}, the noise model wants ({dimension},)")
    if len(blocks) != keys or any(block.ndim != 2 or len(block) != dimension for block in blocks):
        shapes = [block.shape for block in blocks]
        raise ValueError(f"Jacobians have shapes {shapes}, wanted {keys} with {dimension} rows each")


def plane_parts(values: gtsam.Values, key: int) -> tuple[FloatArray, float, FloatArray]:
    """(3,) normal, d and the (3, 2) tangent basis of the normal of an ``OrientedPlane3`` variable."""
    plane = values.atOrientedPlane3(key)
    normal = plane.normal()
    return normal.point3(), plane.distance(), normal.basis()
