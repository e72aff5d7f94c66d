"""How far the cameras may be wrong without the tracks showing it, and what that does to depths."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from gtlayout.camera_errors.camera_response import CameraResponse
from gtlayout.camera_errors.findings import CameraDoubt
from gtlayout.camera_errors.fit import Problem, pose_noise, posterior
from gtlayout.camera_errors.observations import frames_seen
from gtlayout.camera_errors.reprojection import DIMENSIONS, linearise
from gtlayout.scene import FloatArray, Scene
from gtlayout.tracking.config import CameraErrorConfig, TriangulationConfig
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks, triangulate


def camera_response(
    given: Scene,
    scene: Scene,
    evidence: Tracks,
    tracks: Tracks,
    rays: TriangulatedTracks,
    doubt: CameraDoubt,
    triangulation: TriangulationConfig,
    config: CameraErrorConfig,
    seed: int,
) -> CameraResponse:
    """The strongest ``config.response_directions`` directions of what remains unknown of the cameras of ``scene``.

    Errors that all cameras share and those of single poses are unknowns together, with priors; what ``evidence``, the
    tracks that cameras are judged by, leaves open of them is propagated to the depths of all ``tracks``, whose ``rays``
    are triangulated. ``doubt`` is what was found out about the shared ones. ``given`` is the scene corrected where it
    says so: its poses show how large the noise is that the refined ones of ``scene`` came from. Deterministic in
    ``seed``.
    """
    order = np.random.default_rng(seed).permutation(len(evidence))[: config.max_tracks]
    if not doubt.findings or len(order) < config.min_tracks:
        return CameraResponse.none(len(tracks), len(scene.key_frames))
    local = Normalisation.of(rays)
    frames = np.union1d(*(frames_seen(scene, some, config.max_frames) for some in (evidence, tracks)))

    def of(cameras: Scene) -> Problem:
        again = triangulate(cameras, evidence, triangulation)
        return Problem.of(cameras, evidence, again, order, config, frames, local)

    problem = of(scene)
    before = problem if given is scene else of(given)
    first = pose_noise(before, remaining(doubt, config, 1.0))
    # Poses without noise come from a good calibration, and poses with much from one that may be off in all else, too.
    size = first.size_in(problem.least_noise)
    share = float(np.clip(config.floor_by_noise * size**2, *config.floor_shares))
    prior_covariance = remaining(doubt, config, share)
    covariance = posterior(problem, prior_covariance, pose_noise(before, prior_covariance))
    values, vectors = np.linalg.eigh(covariance)
    # (D, D) changes of the cameras by independent errors of one σ each.
    changes = vectors * np.sqrt(np.maximum(values, 0.0))
    # Only directions that change depths matter, and few of them do.
    some = _depth_shares(problem, changes)
    strength, directions = np.linalg.eigh(some.T @ some)
    strongest = changes @ directions[:, np.argsort(-strength, kind="stable")[: config.response_directions]]
    every = Problem.of(scene, tracks, rays, np.arange(len(tracks)), config, frames, local)
    rho_share = np.zeros((len(tracks), strongest.shape[1]))
    rho_share[every.seen.tracks] = _depth_shares(every, strongest)
    of_cameras = strongest.reshape(-1, DIMENSIONS, strongest.shape[1])
    at_key = np.searchsorted(problem.seen.frames, [key_frame.frame for key_frame in scene.key_frames])
    R = np.array([scene.frame_of(k).camera.R_cam_from_world for k in range(len(scene.key_frames))])
    turn = -np.einsum("kji,kjq->kqi", R, of_cameras[at_key, :3])
    center = of_cameras[at_key, 3:6].transpose(0, 2, 1) / local.scale
    return CameraResponse(rho_share, center, turn)


def remaining(doubt: CameraDoubt, config: CameraErrorConfig, floor_share: float) -> FloatArray:
    """(P, P) covariance of the values of all shared errors: most cameras are right, some are badly wrong.

    Each error is one of two: as small as in good cameras, or as large as its prior has it. How likely it is the second,
    its value says (Bayes' rule); the value itself counts by that probability, as a square. ``floor_share`` is how many
    times as large as usual the errors of these cameras are where they are small.
    """
    blocks = []
    for finding in doubt.findings:
        size, scale = finding.error.size, finding.error.scale
        small, large = (floor_share * scale.floor) ** 2 / 4, scale.prior**2
        if finding.decision == "corrected":
            blocks.append(finding.covariance)
            continue
        found = finding.covariance + (floor_share**2 - 1) * scale.floor**2 * np.eye(size)
        odds = (
            config.wrong_share
            / (1 - config.wrong_share)
            * np.exp(
                _log_density(finding.values, found + large * np.eye(size))
                - _log_density(finding.values, found + small * np.eye(size))
            )
        )
        wrong = float(odds / (1 + odds))
        spread = (wrong * large + (1 - wrong) * small) * np.eye(size)
        blocks.append(spread + wrong * np.outer(finding.values, finding.values))
    return np.asarray(block_diag(*blocks), np.float64)


def _log_density(values: FloatArray, covariance: FloatArray) -> float:
    """Of a normal distribution about zero, up to a constant."""
    _, log_determinant = np.linalg.slogdet(covariance)
    return -0.5 * float(values @ np.linalg.solve(covariance, values) + log_determinant)


def _depth_shares(problem: Problem, changes: FloatArray) -> FloatArray:
    """(N, Q) changes of inverse depths, as shares of them, that (D, Q) changes of the cameras make."""
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
    return -pull / (np.maximum(known, 1e-9) * problem.rho)[:, None]
