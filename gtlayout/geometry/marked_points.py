"""A point of the room from where people marked it in several images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.scene import Camera, FloatArray

SIGMA_MARK_PX = 1.0
"""σ of a mark."""
MAX_RESIDUAL_PX = 5.0
"""A mark that is further from where the others place the point is of another point."""
MIN_ANGLE_DEG = 2.0
"""Between the two most different rays to a point; below, its depth is not determined."""
STEPS = 20


@dataclass(frozen=True)
class Mark:
    """Where a point is in one image."""

    frame: str
    camera: Camera
    px: FloatArray
    """(2,) in the pinhole image."""


def triangulated(marks: Sequence[Mark], where: str) -> tuple[FloatArray, FloatArray]:
    """(3,) the world point with the least squared reprojection error, and its (3, 3) covariance for 1 px.

    Raises GtlayoutError, beginning with ``where``, when the images see it from nearly the same place, or the marks
    disagree.
    """
    rays = np.array([mark.camera.rays_world(mark.px[None])[0] for mark in marks])
    directions = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    cosine = min(float(a @ b) for a, b in combinations(directions, 2))
    angle_deg = math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
    centers = np.array([mark.camera.center_world for mark in marks])
    # The point nearest to all rays; the projector onto what is across a ray is I - d dᵀ.
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    point = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, centers), rcond=None)[0]
    if angle_deg < MIN_ANGLE_DEG:
        raise GtlayoutError(
            f"{where}: its frames see it from directions only {angle_deg:.1f}° apart; "
            "mark it in frames from more different places"
        )
    for _ in range(STEPS):
        residual, jacobian = _reprojection(marks, point)
        point = point - np.linalg.lstsq(jacobian, residual.ravel(), rcond=None)[0]
    residual, jacobian = _reprojection(marks, point)
    errors_px = np.linalg.norm(residual, axis=1)
    worst = int(np.argmax(errors_px)) if np.all(np.isfinite(errors_px)) else 0
    depths = [float(mark.camera.project(point[None])[1][0]) for mark in marks]
    if not errors_px[worst] <= MAX_RESIDUAL_PX or min(depths) <= 0:
        raise GtlayoutError(
            f"{where}: its marks are not of one point, worst in frame {marks[worst].frame} "
            f"({errors_px[worst]:.1f} px off); mark the same point in every frame"
        )
    return point, np.asarray(SIGMA_MARK_PX**2 * np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)


def _reprojection(marks: Sequence[Mark], point_world: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, 2) projected minus marked, px, and its (2N, 3) derivative."""
    residuals, jacobians = [], []
    for mark in marks:
        camera = mark.camera
        M = camera.K @ camera.R_cam_from_world
        x, y, z = M @ point_world + camera.K @ camera.t_cam_from_world
        residuals.append(np.array([x / z, y / z]) - mark.px)
        jacobians.append((M[:2] - np.outer([x / z, y / z], M[2])) / z)
    return np.array(residuals), np.concatenate(jacobians)
