"""How much two cameras see of the same."""

from __future__ import annotations

import numpy as np

from gtlayout.scene import Camera, FloatArray

GRID = 8
"""Pixels each way whose position in another image shows how much both have in common."""


def overlap(a: Camera, b: Camera, rho: float) -> float:
    """Share of the first camera's pixels that the second sees, too, were all points at one inverse depth ``rho``."""
    return share_seen(at_inverse_depth(a, rho), b, rho)


def at_inverse_depth(camera: Camera, rho: float) -> FloatArray:
    """(N, 3) points all over the camera's image at one inverse depth, multiplied by it, so that it may be 0."""
    share = (np.arange(GRID) + 0.5) / GRID
    pixels = np.stack(np.meshgrid(share * camera.width, share * camera.height), axis=-1).reshape(-1, 2)
    return camera.rays_world(pixels) + rho * camera.center_world


def share_seen(points_world: FloatArray, camera: Camera, scale: float = 1.0) -> float:
    """Share of (N, 3) points, all multiplied by ``scale`` already, that lie in the image of a camera, N > 0."""
    x, y = _projected(points_world, camera, scale).T
    return float(np.mean((x > 0) & (x < camera.width) & (y > 0) & (y < camera.height)))


def image_motion(points_world: FloatArray, a: Camera, b: Camera, scale: float = 1.0) -> float:
    """By how much of the image's width or height (N, 3) points move from one camera to the other, mean, each at most 1.

    Points as for ``share_seen``; one that is behind a camera has moved by 1.
    """
    size = np.array([a.width, a.height])
    moved = np.abs((_projected(points_world, b, scale) - _projected(points_world, a, scale)) / size).max(axis=1)
    return float(np.mean(np.minimum(np.nan_to_num(moved, nan=1.0), 1.0)))


def _projected(points_world: FloatArray, camera: Camera, scale: float) -> FloatArray:
    """(N, 2) px; NaN for points behind the camera."""
    points_cam = points_world @ camera.R_cam_from_world.T + scale * camera.t_cam_from_world
    homogeneous = points_cam @ camera.K.T
    return np.asarray(homogeneous[:, :2] / np.where(points_cam[:, 2] > 0, homogeneous[:, 2], np.nan)[:, None])
