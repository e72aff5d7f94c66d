"""Doors and windows lie in, or a little behind, their wall."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from gtlayout.factors.batching import FloatArray, custom_factor, plane_parts


def coplanarity_factor(plane_keys: tuple[int, int], point: FloatArray, noise: Any) -> gtsam.CustomFactor:
    """``r = (n_b × n_a, (n_a − n_b) · p + d_a − d_b)``: angle between two planes, and distance between them at p.

    Args:
        plane_keys: two ``OrientedPlane3`` variables a and b.
        point: (3,) where the offsets are compared: amid the smaller of the two instances, world unit.
        noise: 4-D noise model, (radians × 3, world unit); may be robust.
    """

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        (n_a, d_a, basis_a), (n_b, d_b, basis_b) = (plane_parts(values, key) for key in plane_keys)
        error = np.append(np.cross(n_b, n_a), (n_a - n_b) @ point + d_a - d_b)
        if not want_jacobians:
            return error, []
        by_a, by_b = np.zeros((4, 3)), np.zeros((4, 3))
        by_a[:3, :2] = np.cross(n_b, basis_a.T).T
        by_b[:3, :2] = -np.cross(n_a, basis_b.T).T
        by_a[3] = np.append(point @ basis_a, 1.0)
        by_b[3] = -np.append(point @ basis_b, 1.0)
        return error, [by_a, by_b]

    return custom_factor(noise, list(plane_keys), residual)
