"""Matches against cameras: how far each match is from any point in front of both, and how near that point is."""

from __future__ import annotations

import numpy as np

from gtlayout.check.images import Matches
from gtlayout.scene import Camera, FloatArray, Scene
from gtlayout.tracking.triangulation import camera_path

MAX_ERROR_SHARE = 0.01
"""A match fits two cameras within so much of the focal length: 0.6°, several times what poor poses err by."""


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
    """Median inverse depth of the matches, 1 / world unit, from those pairs that fit and move more than others.

    0 without motion, and near 0 when that is too little to see: noise then puts half of the points beyond infinity.
    """
    if not camera_path(scene):
        return 0.0
    found: list[tuple[float, FloatArray]] = []
    for m in matches:
        source, target = scene.frames[m.source].camera, scene.frames[m.target].camera
        errors_px, rho = triangulate_pair(m, source, target)
        if np.median(errors_px) < MAX_ERROR_SHARE * target.K[0, 0]:
            found.append((float(np.linalg.norm(source.center_world - target.center_world)), rho))
    if not found:
        return 0.0
    middle_baseline = np.median([baseline for baseline, _ in found])
    return float(np.median(np.concatenate([rho for baseline, rho in found if baseline >= middle_baseline])))
