"""Points of known inverse depth on a plane: a track without its landmark."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from gtlayout.factors.batching import FloatArray, custom_factor, plane_parts


def depth_factor(
    plane_key: int, centers: FloatArray, rays: FloatArray, rho: FloatArray, noise: Any
) -> gtsam.CustomFactor:
    """``r_i = ρ_i + n · v_i / (n · c_i + d)``: inverse depth along the ray c + v / ρ minus that of the plane.

    What is left of tracks when their landmarks are eliminated by triangulation: three unknowns a plane in all, so many
    starts can be tried for the price of one solve with landmarks.

    Args:
        plane_key: an ``OrientedPlane3`` variable.
        centers: (m, 3) camera centres c, world unit.
        rays: (m, 3) directions v with z = 1 in their camera.
        rho: (m,) inverse depths, 1 / world unit.
        noise: m-D noise model; may be robust, with a weight per row.
    """

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        normal, d, basis = plane_parts(values, plane_key)
        facing, clearance = rays @ normal, centers @ normal + d
        # A plane through a camera centre has no depth there; which side of zero it is on does not matter then.
        clearance = np.where(np.abs(clearance) < 1e-6, 1e-6, clearance)
        error = rho + facing / clearance
        if not want_jacobians:
            return error, []
        by_clearance = -facing / clearance**2
        by_normal = rays / clearance[:, None] + by_clearance[:, None] * centers
        return error, [np.column_stack([by_normal @ basis, by_clearance])]

    return custom_factor(noise, [plane_key], residual)
