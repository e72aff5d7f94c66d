"""The normal equations of all cameras with the points' depths eliminated: one linearisation for every hypothesis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.camera_errors.observations import Observations
from gtlayout.camera_errors.path import CameraPath
from gtlayout.camera_errors.reprojection import DIMENSIONS, linearise
from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class CameraSystem:
    """Second-order model of the robust cost round a path, in units of the variance of the residuals.

    D = 9 F: the changes of the F cameras, as ``DIMENSIONS`` has them.
    """

    information: FloatArray
    """(D, D)"""
    scores: FloatArray
    """(N, D) gradient of each track's cost; independent of one another, unlike the positions of a track."""
    rho_information: FloatArray
    """(N,) of the depths."""
    rho_gradient: FloatArray
    """(N,)"""
    mixed: FloatArray
    """(N, D) of depths and cameras."""

    def rho_step(self, change: FloatArray) -> FloatArray:
        """(N,) what a (D,) change of the cameras makes of the points' inverse depths."""
        return -(self.rho_gradient + self.mixed @ change) / self.rho_information


def camera_system(
    path: CameraPath, seen: Observations, rho: FloatArray, cauchy: float, sigma_factor: float
) -> CameraSystem:
    """Linearise at the ``path`` of the F frames of ``seen`` and at (N,) inverse depths.

    ``cauchy`` is the scale of the robust weights in σ of a position; where half of the residuals are larger than
    that, cameras are wrong, not tracks, and the scale grows along. ``sigma_factor`` on the noise of positions makes up
    for their not being independent.
    """
    at = linearise(path, seen, rho)
    squared = np.sum(at.residual**2, axis=1) / seen.sigma_px**2
    scale2 = max(cauchy**2, 2 * float(np.median(squared)))
    weight = 1 / (1 + squared / scale2)
    variance = max(float(np.mean(weight * squared)) / 2, 1e-6)
    weight /= (sigma_factor * seen.sigma_px) ** 2 * variance
    first, count, frames = seen.first, len(seen.tracks), len(seen.frames)

    def per_track(values: FloatArray) -> FloatArray:
        return np.add.reduceat(values, first, axis=0)

    weighted_rho = weight[:, None] * at.by_rho
    # A point without parallax has no depth, and hardly any weight in what follows.
    rho_information = per_track(np.sum(weighted_rho * at.by_rho, axis=1)) + 1e-9
    rho_gradient = per_track(np.sum(weighted_rho * at.residual, axis=1))
    weighted = weight[:, None] * at.residual
    mixed, scores = np.zeros((count, frames, DIMENSIONS)), np.zeros((count, frames, DIMENSIONS))
    for by_camera, frame in ((at.by_camera, seen.frame), (at.by_key_camera, seen.key_frame)):
        np.add.at(mixed, (seen.track, frame), np.einsum("mi,mid->md", weighted_rho, by_camera))
        np.add.at(scores, (seen.track, frame), np.einsum("mi,mid->md", weighted, by_camera))
    by_camera_and_rho, by_cameras = mixed.reshape(count, -1), scores.reshape(count, -1)
    information = _camera_information(at.by_camera, at.by_key_camera, weight, seen)
    return CameraSystem(
        information=information - by_camera_and_rho.T @ (by_camera_and_rho / rho_information[:, None]),
        scores=by_cameras - by_camera_and_rho * (rho_gradient / rho_information)[:, None],
        rho_information=rho_information,
        rho_gradient=rho_gradient,
        mixed=by_camera_and_rho,
    )


def _camera_information(own: FloatArray, key: FloatArray, weight: FloatArray, seen: Observations) -> FloatArray:
    """(D, D) Σ w Jᵀ J of all positions, pair of frames by pair of frames."""
    frames = len(seen.frames)
    both = np.concatenate([own, key], axis=2)
    pair = seen.frame * frames + seen.key_frame
    order = np.argsort(pair, kind="stable")
    pairs, start = np.unique(pair[order], return_index=True)
    information = np.zeros((frames, DIMENSIONS, frames, DIMENSIONS))
    for number, rows in zip(pairs.tolist(), np.split(order, start[1:]), strict=True):
        J = both[rows].reshape(-1, 2 * DIMENSIONS)
        block = J.T @ (np.repeat(weight[rows], 2)[:, None] * J)
        f, k = divmod(number, frames)
        for a, at_a in ((f, slice(None, DIMENSIONS)), (k, slice(DIMENSIONS, None))):
            for b, at_b in ((f, slice(None, DIMENSIONS)), (k, slice(DIMENSIONS, None))):
                information[a, :, b] += block[at_a, at_b]
    return information.reshape(frames * DIMENSIONS, -1)
