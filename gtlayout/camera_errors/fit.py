"""Gauss-Newton for errors that all cameras share, with depths of points and pose noise as further unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from gtlayout.camera_errors.models import CameraError, camera_errors, corrected
from gtlayout.camera_errors.noise import PoseNoise, noise_directions, noisy
from gtlayout.camera_errors.observations import Observations, observe
from gtlayout.camera_errors.path import CameraPath
from gtlayout.camera_errors.system import CameraSystem, camera_system
from gtlayout.scene import FloatArray, IntArray, Scene
from gtlayout.tracking.config import CameraErrorConfig
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks

_STEP = 1e-4
"""Of numerical derivatives, in σ of an error's prior."""
_MAX_RHO_FACTOR = 10.0
"""By which an inverse depth may change in one iteration."""


@dataclass(frozen=True)
class Problem:
    """What a fit is made from."""

    path: CameraPath
    """The given cameras of all frames, in a world of a room's size."""
    seen: Observations
    rho: FloatArray
    """(N,) inverse depths with the given cameras."""
    errors: Sequence[CameraError]
    config: CameraErrorConfig

    @classmethod
    def of(
        cls,
        scene: Scene,
        tracks: Tracks,
        rays: TriangulatedTracks,
        chosen: IntArray,
        config: CameraErrorConfig,
        frames: IntArray,
        local: Normalisation,
    ) -> Self:
        """The problem of the ``chosen`` tracks in (F,) sorted ``frames``, in the ``local`` world."""
        seen = observe(scene, tracks, chosen, frames, config.max_observations)
        rho = local.rays(rays).rho[seen.tracks]
        return cls(CameraPath.of(scene, local), seen, rho, camera_errors(config), config)

    @property
    def priors(self) -> FloatArray:
        """(P,) σ of all errors' values."""
        return np.concatenate([np.full(error.size, error.scale.prior) for error in self.errors])

    @property
    def first_noise(self) -> PoseNoise:
        """Pose noise to start from: that of poor cameras. From above its size is found in fewer steps."""
        return self.least_noise.times(self.config.first_noise)

    @property
    def least_noise(self) -> PoseNoise:
        """Pose noise that good cameras have."""
        config = self.config
        smooth, white = (
            np.array([np.deg2rad(degrees), position]) ** 2
            for degrees, position in (config.least_smooth, config.least_white)
        )
        return PoseNoise.between(self.seen.frames, config.correlated_frames, smooth, white)


@dataclass(frozen=True)
class Fit:
    """Where Gauss-Newton ended, and its last linearisation with depths and pose noise eliminated."""

    values: FloatArray
    """(P,) of all errors; 0 of those that were not fitted."""
    information: FloatArray
    """(P, P) of all values, fitted or not."""
    gradient: FloatArray
    """(P,) by all values; 0 of those fitted, once converged."""
    spread: FloatArray
    """(P, P) covariance of ``gradient``, from how the tracks' own gradients differ."""

    def optimum(self, chosen: IntArray) -> tuple[FloatArray, FloatArray]:
        """(C,) values where the cost is least with only the ``chosen`` ones free, and their (C, C) covariance."""
        inverse = np.linalg.inv(self.information[np.ix_(chosen, chosen)])
        values = self.values[chosen] - inverse @ self.gradient[chosen]
        return values, inverse @ self.spread[np.ix_(chosen, chosen)] @ inverse


def fit(problem: Problem, active: IntArray, start: FloatArray) -> Fit:
    """Fit the values with indices ``active`` from (P,) ``start`` on; the others stay as they are there.

    Pose noise is an unknown with a prior whose size is learned on the way (expectation maximisation), so that what
    noise explains as well is no evidence for an error.
    """
    seen, config = problem.seen, problem.config
    least, noise_prior = problem.least_noise, problem.first_noise
    values, rho, noise = start.copy(), problem.rho, np.zeros(6 * len(seen.frames))
    by_noise = noise_directions(len(seen.frames))
    for _ in range(config.iterations):
        system, by_values = _linearised(problem, values, noise, rho)
        directions = np.hstack([by_values[:, active], by_noise])
        information = directions.T @ system.information @ directions
        gradient = directions.T @ system.scores.sum(axis=0)
        before = np.concatenate([values[active], noise])
        for _ in range(config.noise_steps):
            prior = np.zeros_like(information)
            prior[: len(active), : len(active)] = np.diag(problem.priors[active] ** -2)
            prior[len(active) :, len(active) :] = noise_prior.information()
            covariance = np.asarray(np.linalg.inv(information + prior), np.float64)
            after = before - covariance @ (gradient + prior @ before)
            noise = after[len(active) :]
            noise_prior = noise_prior.learned(noise, covariance[len(active) :, len(active) :], least)
        values[active] = after[: len(active)]
        stepped = rho + system.rho_step(directions @ (after - before))
        rho = np.clip(stepped, rho / _MAX_RHO_FACTOR, rho * _MAX_RHO_FACTOR)
    system, by_values = _linearised(problem, values, noise, rho)
    return _without_noise(system, by_values, by_noise, values, noise, noise_prior, problem.priors)


def pose_noise(problem: Problem, prior_covariance: FloatArray) -> PoseNoise:
    """The size of the noise of the problem's poses, learned as in ``fit``, but down to what exact cameras have.

    With the (P, P) covariance of what is known of the errors' values without these tracks. The tracks count by the
    noise they have, without the factor on σ of what is found by them: it would hide noise that they show.
    """
    config, count = problem.config, len(problem.priors)
    least, noise = problem.least_noise.times(config.exact_noise_share), problem.first_noise
    information, gradient, _ = _without_depths(problem, 1.0)
    for _ in range(config.response_steps):
        covariance, mean = _with_priors(information, gradient, prior_covariance, noise)
        noise = noise.learned(mean[count:], covariance[count:, count:], least)
    return noise


def posterior(problem: Problem, prior_covariance: FloatArray, noise: PoseNoise) -> FloatArray:
    """(D, D) second moment, given the tracks, of the changes that would correct the problem's cameras.

    Of all errors and of pose noise together: what the tracks leave open of them, and what they say of the errors, which
    is not corrected. With the (P, P) covariance of what is known of the errors' values without these tracks, and the
    size of the noise that the poses came with.
    """
    count = len(problem.priors)
    # Where σ of what is found must be larger by a factor, its information is less by the square of it.
    information, gradient, directions = _without_depths(problem, problem.config.confidence_factor**-2)
    moment, mean = _with_priors(information, gradient, prior_covariance, noise)
    moment[:count, :count] += np.outer(mean[:count], mean[:count])
    return directions @ moment @ directions.T


def _without_depths(problem: Problem, weight: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """At the problem's cameras: information and gradient by all errors and pose noise, and what these change."""
    frames = len(problem.seen.frames)
    system, by_values = _linearised(problem, np.zeros(len(problem.priors)), np.zeros(6 * frames), problem.rho)
    directions = np.hstack([by_values, noise_directions(frames)])
    information = weight * directions.T @ system.information @ directions
    return information, weight * directions.T @ system.scores.sum(axis=0), directions


def _with_priors(
    information: FloatArray, gradient: FloatArray, prior_covariance: FloatArray, noise: PoseNoise
) -> tuple[FloatArray, FloatArray]:
    """Covariance and mean of all errors and pose noise."""
    count = len(prior_covariance)
    known = information.copy()
    known[:count, :count] += np.linalg.inv(prior_covariance)
    known[count:, count:] += noise.information()
    covariance = np.asarray(np.linalg.inv(known), np.float64)
    return covariance, -covariance @ gradient


def _linearised(
    problem: Problem, values: FloatArray, noise: FloatArray, rho: FloatArray
) -> tuple[CameraSystem, FloatArray]:
    """The system, and (D, P) changes of the cameras by each value."""
    path, frames = problem.path, problem.seen.frames
    columns = []
    for i, prior in enumerate(problem.priors):
        step = np.zeros(len(values))
        step[i] = _STEP * prior
        below, above = (corrected(path, problem.errors, values + sign * step) for sign in (-1, 1))
        columns.append((below.at(frames).change_to(above.at(frames)) / (2 * step[i])).ravel())
    now = noisy(corrected(path, problem.errors, values).at(frames), noise)
    config = problem.config
    return camera_system(now, problem.seen, rho, config.cauchy, config.sigma_factor), np.column_stack(columns)


def _without_noise(
    system: CameraSystem,
    by_values: FloatArray,
    by_noise: FloatArray,
    values: FloatArray,
    noise: FloatArray,
    noise_prior: PoseNoise,
    priors: FloatArray,
) -> Fit:
    """Eliminate the pose noise."""
    noise_information, value_information = noise_prior.information(), np.diag(priors**-2)
    weighted = system.information @ by_noise
    mixed = weighted.T @ by_values
    response = np.linalg.solve(by_noise.T @ weighted + noise_information, mixed)
    own_scores = system.scores @ (by_values - by_noise @ response)
    gradient = own_scores.sum(axis=0) + value_information @ values - response.T @ (noise_information @ noise)
    information = by_values.T @ system.information @ by_values + value_information - mixed.T @ response
    spread = own_scores.T @ own_scores + response.T @ noise_information @ response + value_information
    return Fit(values, information, gradient, spread)
