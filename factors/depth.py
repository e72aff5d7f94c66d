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

    The factor of tracks whose landmarks are eliminated by triangulation. There are only three unknowns per plane, so
    many starts can be tried in the time of one solve with landmarks.

    Args:
        plane_key: an ``OrientedPlane3`` variable.
        centers: (m, 3) camera centres c, world unit.
        rays: (m, 3) directions v with z = 1 in their camera.
        rho: (m,) inverse depths, 1 / world unit.
        noise: m-D noise model; may be robust, with a weight per row.
    """

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        error, by_plane = _deviation(values, plane_key, centers, rays, rho)
        return error, [by_plane] if want_jacobians else []

    return custom_factor(noise, [plane_key], residual)


def biased_depth_factor(
    keys: tuple[int, int], centers: FloatArray, rays: FloatArray, rho: FloatArray, bias_by: FloatArray, noise: Any
) -> gtsam.CustomFactor:
    """``r_i = ρ_i + n · v_i / (n · c_i + d) − h_i · b``: as above, for points that share the error ``h_i · b``.

    Args:
        keys: an ``OrientedPlane3`` and a ``Point3`` variable, the plane and the bias b.
        centers: (m, 3) camera centres c, world unit.
        rays: (m, 3) directions v with z = 1 in their camera.
        rho: (m,) inverse depths, 1 / world unit.
        bias_by: (m, 3) h, the inverse depth that one unit of each component of b makes, 1 / world unit.
        noise: m-D noise model.
    """

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        error, by_plane = _deviation(values, keys[0], centers, rays, rho)
        return error - bias_by @ values.atPoint3(keys[1]), [by_plane, -bias_by] if want_jacobians else []

    return custom_factor(noise, list(keys), residual)


def _deviation(
    values: gtsam.Values, plane_key: int, centers: FloatArray, rays: FloatArray, rho: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(m,) inverse depths minus those of the plane, and their (m, 3) derivative by the plane."""
    normal, d, basis = plane_parts(values, plane_key)
    facing, clearance = rays @ normal, centers @ normal + d
    # A plane through a camera centre has no depth there; which side of zero it is on does not matter then.
    clearance = np.where(np.abs(clearance) < 1e-6, 1e-6, clearance)
    by_clearance = -facing / clearance**2
    by_normal = rays / clearance[:, None] + by_clearance[:, None] * centers
    return rho + facing / clearance, np.column_stack([by_normal @ basis, by_clearance])
