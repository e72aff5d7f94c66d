"""How much two cameras see of the same."""

from __future__ import annotations

import numpy as np

from gtlayout.scene import Camera, FloatArray

GRID = 8
"""Pixels each way whose position in another image shows how much both have in common."""


def overlap(a: Camera, b: Camera, rho: float) -> float:
    """Share of the first camera's pixels that the second sees, too, were all points at one inverse depth ``rho``."""
    share = (np.arange(GRID) + 0.5) / GRID
    pixels = np.stack(np.meshgrid(share * a.width, share * a.height), axis=-1).reshape(-1, 2)
    # The points times ρ, so that it may be 0.
    return share_seen(a.rays_world(pixels) + rho * a.center_world, b, rho)


def share_seen(points_world: FloatArray, camera: Camera, scale: float = 1.0) -> float:
    """Share of (N, 3) points, each multiplied by ``scale``, that lie in the image of a camera, N > 0."""
    points_cam = points_world @ camera.R_cam_from_world.T + scale * camera.t_cam_from_world
    in_front = points_cam[:, 2] > 0
    x, y, _ = (points_cam @ camera.K.T / np.where(in_front, points_cam[:, 2], np.nan)[:, None]).T
    return float(np.mean(in_front & (x > 0) & (x < camera.width) & (y > 0) & (y < camera.height)))
