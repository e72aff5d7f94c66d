"""Reprojection errors as a function of inverse depths and of all cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.camera_errors.observations import Observations
from gtlayout.camera_errors.path import CameraPath
from gtlayout.scene import FloatArray

DIMENSIONS = 9
"""Of a camera's change: rotation vector in the camera, shift of the centre in the world, log of the focal length's
factor, shift of the principal point."""


@dataclass(frozen=True)
class Linearised:
    """Residuals and their derivatives; the cameras' are by a change as ``DIMENSIONS`` has it."""

    residual: FloatArray
    """(M, 2) px: where a point projects to, minus where it was seen."""
    by_rho: FloatArray
    """(M, 2)"""
    by_camera: FloatArray
    """(M, 2, 9) by the camera that sees the point."""
    by_key_camera: FloatArray
    """(M, 2, 9) by that of the key frame, which fixes the point's ray."""


def linearise(path: CameraPath, seen: Observations, rho: FloatArray) -> Linearised:
    """With q = R (Rₖᵀ rₖ + ρ (cₖ − c)), ρ times a point in the camera, rₖ = Kₖ⁻¹ uₖ, and the residual π(K q) − u."""
    residual, q, ray_cam, slope = _project(path, seen, rho)
    K, K_key = path.K[seen.frame], path.K[seen.key_frame]
    projected = residual + seen.points_px
    by_q = (K[:, :2] - projected[:, :, None] * np.array([0.0, 0.0, 1.0])) / q[:, 2, None, None]
    R, R_key = path.R_cam_from_world[seen.frame], path.R_cam_from_world[seen.key_frame]
    by_center = rho[seen.track, None, None] * by_q @ R
    own, key = (np.zeros((len(residual), 2, DIMENSIONS)) for _ in range(2))
    own[:, :, :3] = -by_q @ _cross(q)
    own[:, :, 3:6] = -by_center
    own[:, :, 6] = projected - K[:, :2, 2]
    own[:, :, 7:] = np.eye(2)
    by_ray = by_q @ R @ R_key.transpose(0, 2, 1)
    key[:, :, :3] = by_ray @ _cross(ray_cam)
    key[:, :, 3:6] = by_center
    key[:, :, 6] = -np.einsum("mij,mj->mi", by_ray[:, :, :2], ray_cam[:, :2])
    key[:, :, 7:] = -by_ray[:, :, :2] / K_key[:, None, [0, 1], [0, 1]]
    return Linearised(residual, np.einsum("mij,mj->mi", by_q, slope), own, key)


def _project(
    path: CameraPath, seen: Observations, rho: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """(M, 2) residuals; (M, 3) each: q, the ray in the key frame's camera, and d q / d ρ."""
    homogeneous = np.column_stack([seen.key_px, np.ones(len(seen.track))])
    ray_cam = np.einsum("mij,mj->mi", np.linalg.inv(path.K)[seen.key_frame], homogeneous)
    ray_world = np.einsum("mji,mj->mi", path.R_cam_from_world[seen.key_frame], ray_cam)
    baseline = path.centers_world[seen.key_frame] - path.centers_world[seen.frame]
    R = path.R_cam_from_world[seen.frame]
    slope = np.einsum("mij,mj->mi", R, baseline)
    q = np.einsum("mij,mj->mi", R, ray_world) + rho[seen.track, None] * slope
    q[:, 2] = np.where(np.abs(q[:, 2]) < 1e-9, 1e-9, q[:, 2])
    projected = np.einsum("mij,mj->mi", path.K[seen.frame][:, :2], q) / q[:, 2:]
    return projected - seen.points_px, q, ray_cam, slope


def _cross(vectors: FloatArray) -> FloatArray:
    """(M, 3, 3) matrices of the cross products with (M, 3) vectors from the left."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
