"""Matches against cameras: how far each match is from any point in front of both, and how near that point is."""

from __future__ import annotations

import numpy as np

from gtlayout.check.images import Matches
from gtlayout.scene import Camera, FloatArray, Scene
from gtlayout.triangulation import camera_path


def triangulate_pair(matches: Matches, source: Camera, target: Camera) -> tuple[FloatArray, FloatArray]:
    """Per match the error (N,) in px of the target and the inverse depth (N,) in the source, 1 / world unit.

    A match's point lies on its pixel's ray at an inverse depth ρ of 0 (as far as the sky) or more, and its homogeneous
    image is ``far + ρ slope``: ρ by linear least squares. The error is infinite where that is behind the target camera.
    """
    far = source.rays_world(matches.source_px) @ (target.K @ target.R_cam_from_world).T
    slope = target.K @ (target.R_cam_from_world @ source.center_world + target.t_cam_from_world)
    a = slope[:2] - matches.target_px * slope[2]
    b = matches.target_px * far[:, 2:] - far[:, :2]
    rho = np.maximum(np.sum(a * b, axis=1) / np.maximum(np.sum(a * a, axis=1), 1e-300), 0.0)
    homogeneous = far + rho[:, None] * slope
    in_front = homogeneous[:, 2] > 0
    projected = homogeneous[:, :2] / np.where(in_front, homogeneous[:, 2], 1.0)[:, None]
    errors_px = np.linalg.norm(projected - matches.target_px, axis=1)
    return np.where(in_front, errors_px, np.inf), rho


def middle_inverse_depth(scene: Scene, matches: list[Matches]) -> float:
    """Median inverse depth of the matched points, 1 / world unit, from the half of the pairs with the most motion.

    0 without motion, and near 0 when that is too little to see: noise then puts half of the points beyond infinity.
    """
    if not camera_path(scene):
        return 0.0
    pairs = [(m, scene.frames[m.source].camera, scene.frames[m.target].camera) for m in matches]
    baselines = np.array([np.linalg.norm(a.center_world - b.center_world) for _, a, b in pairs])
    moving = [pair for pair, baseline in zip(pairs, baselines, strict=True) if baseline >= np.median(baselines)]
    return float(np.median(np.concatenate([triangulate_pair(*pair)[1] for pair in moving])))
