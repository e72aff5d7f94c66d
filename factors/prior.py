"""A weak prior that keeps an undetermined plane solvable."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from gtlayout.factors.batching import FloatArray, custom_factor, plane_parts


def plane_prior_factor(plane_key: int, prior: FloatArray, noise: Any) -> gtsam.CustomFactor:
    """``r = (B₀ᵀ n, d − d₀)``: deviation of the normal within the tangent plane of n₀, and of d.

    GTSAM wraps no ``PriorFactor`` of an ``OrientedPlane3`` for Python.

    Args:
        plane_key: an ``OrientedPlane3`` variable.
        prior: (4,) unit n₀ and d₀.
        noise: 3-D noise model, (radians, radians, world unit).
    """
    across = gtsam.Unit3(prior[:3]).basis().T

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        normal, d, basis = plane_parts(values, plane_key)
        error = np.append(across @ normal, d - prior[3])
        if not want_jacobians:
            return error, []
        by_plane = np.zeros((3, 3))
        by_plane[:2, :2] = across @ basis
        by_plane[2, 2] = 1.0
        return error, [by_plane]

    return custom_factor(noise, [plane_key], residual)
