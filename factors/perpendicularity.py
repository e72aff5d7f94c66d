"""Two planes at a right angle, such as a wall and the floor."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from gtlayout.factors.batching import FloatArray, custom_factor, plane_parts


def perpendicularity_factor(plane_keys: tuple[int, int], noise: Any) -> gtsam.CustomFactor:
    """``r = n_a · n_b``: the sine of how far two planes are from a right angle (so σ is an angle in radians).

    Args:
        plane_keys: two ``OrientedPlane3`` variables.
        noise: 1-D noise model, radians; may be robust.
    """

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        (n_a, _, basis_a), (n_b, _, basis_b) = (plane_parts(values, key) for key in plane_keys)
        error = np.array([n_a @ n_b])
        if not want_jacobians:
            return error, []
        return error, [np.append(n_b @ basis_a, 0.0)[None], np.append(n_a @ basis_b, 0.0)[None]]

    return custom_factor(noise, list(plane_keys), residual)
