"""An annotated contact edge lies on the image of the line in which two planes meet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import gtsam
import numpy as np

from gtlayout.factors.batching import FloatArray, custom_factor

_COPLANAR = 0.01
"""Planes that differ by less than this angle (radians) all over the view have no line in which they meet."""
_FARTHEST_PX = 1e9
"""A line farther away than this lies beside the camera: it is nowhere in the image."""
_MIX = np.array([[0.5, 0.5], [0.5, -0.5]])
"""Half-sum and half-difference."""


@dataclass(frozen=True)
class EdgeView:
    """An edge as a camera sees it: all that does not change while the planes do."""

    center: FloatArray
    """(3,) c of the camera, world unit."""
    to_line: FloatArray
    """(3, 3) takes the normal of a plane through c to its line in the image, up to scale."""
    points_px: FloatArray
    """(2, 3) the representative points, homogeneous."""

    @classmethod
    def of(cls, points_px: FloatArray, projection: FloatArray) -> Self:
        """That of (2, 2) representative points, px, in a camera with the (3, 4) ``K [R | t]``, world to px."""
        K_R = projection[:, :3]
        to_line = np.linalg.inv(K_R).T
        # l is only used up to scale, but a determinant near 1 keeps its numbers near the pixel's.
        to_line = to_line / np.cbrt(np.abs(np.linalg.det(to_line)))
        center = np.asarray(-np.linalg.solve(K_R, projection[:, 3]), np.float64)
        return cls(center, to_line, np.column_stack([points_px, np.ones(2)]))


def edge_factor(plane_keys: tuple[int, int], offset_key: int, seen: EdgeView, noise: Any) -> gtsam.CustomFactor:
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
        seen: the edge.
        noise: 2-D noise model for (shift, tilt), px; may be robust.
    """
    key_a, key_b = plane_keys

    # NumPy's helpers for stacks, norms and outer products would take half of the time of all starts.
    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        plane_a, plane_b = values.atOrientedPlane3(key_a), values.atOrientedPlane3(key_b)
        n_a, n_b = plane_a.normal().point3(), plane_b.normal().point3()
        seen_from = seen.center - values.atPoint3(offset_key)
        D_a, D_b = n_a @ seen_from + plane_a.distance(), n_b @ seen_from + plane_b.distance()
        through = D_a * n_b - D_b * n_a
        line = seen.to_line @ through
        length = float(np.hypot(line[0], line[1]))
        nowhere = _FARTHEST_PX * length <= abs(line[2])
        if np.sqrt(through @ through) <= _COPLANAR * max(abs(D_a), abs(D_b)) or nowhere:
            return np.zeros(2), [np.zeros((2, 3))] * 3 if want_jacobians else []
        r = seen.points_px @ line / length
        if not want_jacobians:
            return _MIX @ r, []
        by_line = (seen.points_px - r[:, None] * np.array([line[0], line[1], 0.0]) / length) / length
        g = by_line @ seen.to_line
        g_a, g_b = (g @ n_a)[:, None], (g @ n_b)[:, None]
        by_a, by_b = np.empty((2, 3)), np.empty((2, 3))
        by_a[:, :2] = (g_b * seen_from - D_b * g) @ plane_a.normal().basis()
        by_b[:, :2] = (D_a * g - g_a * seen_from) @ plane_b.normal().basis()
        by_a[:, 2:], by_b[:, 2:] = g_b, -g_a
        return _MIX @ r, [_MIX @ by_a, _MIX @ by_b, _MIX @ (g_a * n_b - g_b * n_a)]

    return custom_factor(noise, [*plane_keys, offset_key], residual)
