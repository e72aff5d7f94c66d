"""An annotated contact edge lies on the image of the line in which two planes meet."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from gtlayout.factors.batching import FloatArray, custom_factor, plane_parts

_COPLANAR = 0.01
"""Planes that differ by less than this angle (radians) all over the view have no line in which they meet."""
_FARTHEST_PX = 1e9
"""A line farther away than this lies beside the camera: it is nowhere in the image."""


def edge_factor(
    plane_keys: tuple[int, int], offset_key: int, points_px: FloatArray, projection: FloatArray, noise: Any
) -> gtsam.CustomFactor:
    """Two residuals in px: half-sum and half-difference of the distances of two edge points from the drawn line.

    That line is the one in which the planes meet, moved by an offset v: what is drawn may be the foot of a baseboard.
    With D = n · (c − v) + d for the camera centre c, ``m = D_a n_b − D_b n_a`` is the normal of the plane through c and
    the line, ``l = K⁻ᵀ R m`` its image, and ``r = l · u / ‖l₁₂‖`` the distance of pixel u from it.

    An edge drawn by one hand is off as a whole, so its points are not independent. Two representative points (mean ±
    one standard deviation along the edge) carry all its information. Their half-sum is its shift, their half-difference
    its tilt.

    Args:
        plane_keys: two ``OrientedPlane3`` variables.
        offset_key: a ``Point3`` variable, v, world unit. Along the line it has no effect.
        points_px: (2, 2) the representative points, px.
        projection: (3, 4) ``K [R | t]`` of the camera, world to px.
        noise: 2-D noise model for (shift, tilt), px; may be robust.
    """
    K_R = projection[:, :3]
    to_line = np.linalg.inv(K_R).T
    center = -np.linalg.solve(K_R, projection[:, 3])
    # l is only used up to scale, but a determinant near 1 keeps its numbers near the pixel's.
    to_line = to_line / np.cbrt(np.abs(np.linalg.det(to_line)))
    u = np.column_stack([points_px, np.ones(2)])
    mix = np.array([[0.5, 0.5], [0.5, -0.5]])

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        (n_a, d_a, basis_a), (n_b, d_b, basis_b) = (plane_parts(values, key) for key in plane_keys)
        seen_from = center - values.atPoint3(offset_key)
        D_a, D_b = n_a @ seen_from + d_a, n_b @ seen_from + d_b
        through = D_a * n_b - D_b * n_a
        line = to_line @ through
        length = float(np.hypot(line[0], line[1]))
        nowhere = _FARTHEST_PX * length <= abs(line[2])
        if np.linalg.norm(through) <= _COPLANAR * max(abs(D_a), abs(D_b)) or nowhere:
            return np.zeros(2), [np.zeros((2, 3))] * 3 if want_jacobians else []
        r = u @ line / length
        if not want_jacobians:
            return mix @ r, []
        by_line = (u - r[:, None] * np.array([line[0], line[1], 0.0]) / length) / length
        g = by_line @ to_line
        g_a, g_b = g @ n_a, g @ n_b
        by_a = np.column_stack([(np.outer(g_b, seen_from) - D_b * g) @ basis_a, g_b])
        by_b = np.column_stack([(D_a * g - np.outer(g_a, seen_from)) @ basis_b, -g_a])
        by_offset = np.outer(g_a, n_b) - np.outer(g_b, n_a)
        return mix @ r, [mix @ by_a, mix @ by_b, mix @ by_offset]

    return custom_factor(noise, [*plane_keys, offset_key], residual)
