"""Upright cylinders: tracks lie on them, and their foot is where they meet a floor or ceiling.

A cylinder is a vector (a, b, R, s, t): where its axis passes through the origin's level, its radius, and how far the
axis leans per unit of height. Its horizontal sections are circles, so that at a small lean it is a cylinder to first
order. Origin and axes of that frame are constants: a third axis, upwards, and two level ones.
"""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from gtlayout.factors.batching import FloatArray, custom_factor, plane_parts


def cylinder_track_factor(
    cylinder_key: int, origin: FloatArray, axes: FloatArray, points: FloatArray, noise: Any
) -> gtsam.CustomFactor:
    """``r_i = ‖q_i‖ − R`` with ``q_i = E (X_i − o) − (a, b) − h_i (s, t)``: level distance of points from the cylinder.

    Args:
        cylinder_key: a 5-D vector variable, see above.
        origin: (3,) o, world unit.
        axes: (3, 3) unit vectors, rows: two level ones, E, and the one upwards; h is the coordinate along it.
        points: (m, 3) X, world unit.
        noise: m-D noise model, world unit.
    """

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        error, by_cylinder, _ = _off(values.atVector(cylinder_key), origin, axes, points)
        return error, [by_cylinder] if want_jacobians else []

    return custom_factor(noise, [cylinder_key], residual)


def cylinder_edge_factor(
    keys: tuple[int, int],
    origin: FloatArray,
    axes: FloatArray,
    centers: FloatArray,
    rays: FloatArray,
    noise: Any,
) -> gtsam.CustomFactor:
    """The residual above for ``X_i = c_i − v_i (n · c_i + d) / (n · v_i)``: drawn points of the foot, on their plane.

    Args:
        keys: a 5-D vector variable, the cylinder, and an ``OrientedPlane3`` variable, the floor or ceiling.
        origin: (3,) as above.
        axes: (3, 3) as above.
        centers: (m, 3) camera centres c, world unit.
        rays: (m, 3) directions v through the drawn pixels.
        noise: m-D noise model, world unit.
    """

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        normal, d, basis = plane_parts(values, keys[1])
        # A ray along the plane meets it nowhere: far away is finite.
        facing = np.where(np.abs(facing := rays @ normal) < 1e-9, 1e-9, facing)
        points = centers - rays * ((centers @ normal + d) / facing)[:, None]
        error, by_cylinder, by_point = _off(values.atVector(keys[0]), origin, axes, points)
        if not want_jacobians:
            return error, []
        # A plane that moves by δ along its normal at X moves X by −v δ / (n · v).
        by_offset = -np.sum(by_point * rays, axis=1) / facing
        by_plane = by_offset[:, None] * np.column_stack([points @ basis, np.ones(len(points))])
        return error, [by_cylinder, by_plane]

    return custom_factor(noise, list(keys), residual)


def _off(
    cylinder: FloatArray, origin: FloatArray, axes: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(m,) level distances from a cylinder, and their (m, 5) and (m, 3) derivatives by it and by the points."""
    local = (points - origin) @ axes.T
    height = local[:, 2:]
    across = local[:, :2] - cylinder[:2] - height * cylinder[3:]
    distance = np.linalg.norm(across, axis=1)
    # On the axis every direction is as good.
    outwards = across / np.maximum(distance, 1e-12)[:, None]
    by_cylinder = np.column_stack([-outwards, -np.ones(len(points)), -height * outwards])
    by_point = outwards @ axes[:2] - (outwards @ cylinder[3:])[:, None] * axes[2]
    return distance - cylinder[2], by_cylinder, by_point
