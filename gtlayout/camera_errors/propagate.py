"""How far the cameras may be wrong without the tracks showing it, and what that does to depths."""

from __future__ import annotations

import numpy as np

from gtlayout.camera_errors.camera_response import CameraResponse
from gtlayout.camera_errors.fit import Problem, posterior
from gtlayout.camera_errors.models import camera_errors
from gtlayout.camera_errors.observations import observe
from gtlayout.camera_errors.path import CameraPath
from gtlayout.camera_errors.reprojection import DIMENSIONS, linearise
from gtlayout.scene import FloatArray, IntArray, Scene
from gtlayout.tracking.config import CameraErrorConfig
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks, camera_path

_BLOCK = 4000
"""Tracks at a time, which bounds the memory."""


def camera_response(
    scene: Scene, tracks: Tracks, rays: TriangulatedTracks, config: CameraErrorConfig, seed: int
) -> CameraResponse:
    """The strongest ``config.response_directions`` directions of what remains unknown of the cameras of ``scene``.

    Errors that all cameras share and those of single poses are unknowns together, with priors; what the tracks leave
    open of them is propagated to the depths of all tracks. Deterministic in ``seed``.
    """
    order = np.random.default_rng(seed).permutation(len(tracks))[: config.max_tracks]
    if len(order) < config.min_tracks or camera_path(scene) == 0.0 or rays.moved_share() < config.min_moved_share:
        return CameraResponse.none(len(tracks), len(scene.key_frames))
    local = Normalisation.of(rays)
    problem = _problem(scene, tracks, rays, np.sort(order), local, config)
    covariance = posterior(problem)
    values, vectors = np.linalg.eigh(covariance)
    # (D, D) changes of the cameras by independent errors of one σ each.
    changes = vectors * np.sqrt(np.maximum(values, 0.0))
    share = np.zeros((len(tracks), len(changes)))
    for start in range(0, len(tracks), _BLOCK):
        block = np.arange(start, min(start + _BLOCK, len(tracks)))
        part = _problem(scene, tracks, rays, block, local, config)
        if len(part.seen.track):
            share[part.seen.tracks] = _depth_change(part, changes) / part.rho[:, None]
    # Only directions that change depths matter, and few of them do.
    strength, directions = np.linalg.eigh(share.T @ share)
    strongest = directions[:, np.argsort(-strength, kind="stable")[: config.response_directions]]
    of_cameras = (changes @ strongest).reshape(-1, DIMENSIONS, strongest.shape[1])
    at_key = np.searchsorted(problem.seen.frames, [key_frame.frame for key_frame in scene.key_frames])
    R = np.array([scene.frame_of(k).camera.R_cam_from_world for k in range(len(scene.key_frames))])
    turn = -np.einsum("kji,kjq->kqi", R, of_cameras[at_key, :3])
    center = of_cameras[at_key, 3:6].transpose(0, 2, 1) / local.scale
    return CameraResponse(share @ strongest, center, turn)


def _problem(
    scene: Scene,
    tracks: Tracks,
    rays: TriangulatedTracks,
    chosen: IntArray,
    local: Normalisation,
    config: CameraErrorConfig,
) -> Problem:
    seen = observe(scene, tracks, chosen, config.max_frames, config.max_observations, keep_frames=True)
    rho = local.rays(rays).rho[seen.tracks]
    return Problem(CameraPath.of(scene, local), seen, rho, camera_errors(config), config)


def _depth_change(problem: Problem, changes: FloatArray) -> FloatArray:
    """(N, Q) changes of inverse depths that (D, Q) changes of the cameras make."""
    seen = problem.seen
    at = linearise(problem.path.at(seen.frames), seen, problem.rho)
    weight = 1 / (1 + np.sum(at.residual**2, axis=1) / (problem.config.cauchy * seen.sigma_px) ** 2)
    weight /= seen.sigma_px**2
    per_camera = changes.reshape(len(seen.frames), DIMENSIONS, -1)
    pull = np.zeros((len(seen.tracks), changes.shape[1]))
    for by_camera, frame in ((at.by_camera, seen.frame), (at.by_key_camera, seen.key_frame)):
        by_change = np.einsum("m,mi,mid->md", weight, at.by_rho, by_camera)
        for f in np.unique(frame):
            here = frame == f
            np.add.at(pull, seen.track[here], by_change[here] @ per_camera[f])
    known = np.add.reduceat(weight * np.sum(at.by_rho**2, axis=1), seen.first)
    return -pull / np.maximum(known, 1e-9)[:, None]
