"""Between stages 1 and 2: errors that all cameras share, found by the tracks before anything is built on the cameras.

No residual between tracks and planes shows them, because everything moves together, but reprojection over the whole
length of the tracks does. A correction must prove itself by tracks that it was not found with.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from gtlayout.camera_errors.findings import CameraDoubt, Decision, Finding
from gtlayout.camera_errors.fit import Fit, Problem, fit
from gtlayout.camera_errors.models import corrected
from gtlayout.camera_errors.observations import frames_seen
from gtlayout.camera_errors.path import CameraPath
from gtlayout.scene import FloatArray, IntArray, Scene
from gtlayout.tracking.config import CameraErrorConfig, TriangulationConfig
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import camera_path, reprojection_px, triangulate


def find_camera_errors(
    scene: Scene, tracks: Tracks, config: CameraErrorConfig, triangulation: TriangulationConfig, seed: int
) -> CameraDoubt:
    """Which errors the cameras of ``scene`` share, by ``tracks``. Deterministic in ``seed``.

    The error that explains most is taken first, then what explains most of the rest. Each must be larger than what
    matters and than its σ, several times, and explain tracks that it was not found with.
    """
    order = np.random.default_rng(seed).permutation(len(tracks))[: config.max_tracks]
    if len(order) < config.min_tracks or camera_path(scene) == 0.0:
        return CameraDoubt()
    rays = triangulate(scene, tracks, triangulation)
    if rays.moved_share() < config.min_moved_share:
        return CameraDoubt()
    fitted, held_out = np.split(order, [round((1 - config.held_out_share) * len(order))])
    frames, local = frames_seen(scene, tracks, config.max_frames), Normalisation.of(rays)
    problem, part = (Problem.of(scene, tracks, rays, chosen, config, frames, local) for chosen in (order, fitted))
    judge = _Judge(scene, tracks.only(np.isin(np.arange(len(tracks)), held_out)), triangulation)
    nothing = np.zeros(len(problem.priors))
    active: list[int] = []
    doubted: list[int] = []
    refused: list[int] = []
    now = fit(problem, _indices(problem, active), nothing)
    given = best = None
    while (candidate := _most_significant(problem, now, active, (*doubted, *refused))) is not None:
        counts = False
        # Of two errors together, neither may prove itself alone: what was doubted is tried with the next one.
        for others in (active, [*active, *doubted])[: 1 + bool(doubted)]:
            trial, kept = _fit_those_that_count(problem, now, [*others, candidate])
            if candidate not in kept:
                continue
            counts = True
            given = given or judge(problem, nothing)
            best = best or given
            tried = judge(problem, fit(part, _indices(problem, kept), nothing).values)
            if tried.better_than(best, config):
                active, now, best = kept, trial, tried
                # What stood against the others may have been this one.
                doubted, refused = [], []
                break
        else:
            (doubted if counts else refused).append(candidate)
    findings = tuple(
        _estimate(problem, now, e, active, "corrected" if e in active else "doubted" if e in doubted else "fine")
        for e in range(len(problem.errors))
    )
    return CameraDoubt(
        findings,
        given_px=given.median_px if given else np.nan,
        corrected_px=best.median_px if best and active else np.nan,
    )


def _indices(problem: Problem, errors: Collection[int]) -> IntArray:
    """Of the values of some errors."""
    of_value = np.repeat(np.arange(len(problem.errors)), [error.size for error in problem.errors])
    return np.flatnonzero(np.isin(of_value, list(errors)))


def _most_significant(problem: Problem, now: Fit, active: list[int], left_out: Collection[int]) -> int | None:
    """The error that would explain most on top of the active ones; None when none would count."""
    found = {}
    for e in range(len(problem.errors)):
        if e not in active and e not in left_out:
            guess = _estimate(problem, now, e, active)
            sigmas = guess.size / guess.sigma
            # Half is enough to try: far from the optimum the linearisation sees too little.
            if 2 * guess.size > guess.error.scale.matters and 2 * sigmas > problem.config.min_sigmas:
                found[e] = sigmas
    return max(found, key=lambda e: found[e], default=None)


def _fit_those_that_count(problem: Problem, now: Fit, errors: list[int]) -> tuple[Fit, list[int]]:
    """Fit some errors together, and again without those that turn out not to count beside the others."""
    while True:
        trial = fit(problem, _indices(problem, errors), _only(problem, now.values, errors))
        kept = [e for e in errors if _counts(problem, trial, e, errors)]
        if kept == errors:
            return trial, kept
        errors = kept


def _only(problem: Problem, values: FloatArray, errors: list[int]) -> FloatArray:
    """(P,) values with 0 for all other errors."""
    kept = _indices(problem, errors)
    only = np.zeros_like(values)
    only[kept] = values[kept]
    return only


def _counts(problem: Problem, at: Fit, error: int, active: list[int]) -> bool:
    """Whether one of the ``active`` errors is larger than what matters, and than its σ."""
    finding = _estimate(problem, at, error, active)
    return finding.size > finding.error.scale.matters and finding.size > problem.config.min_sigmas * finding.sigma


def _estimate(problem: Problem, at: Fit, error: int, active: Collection[int], decision: Decision = "fine") -> Finding:
    """The values of one error where it and the ``active`` ones explain the tracks best."""
    config, chosen = problem.config, problem.errors[error]
    indices = _indices(problem, {*active, error})
    values, covariance = at.optimum(indices)
    own = np.isin(indices, _indices(problem, [error]))
    honest = config.confidence_factor**2 * covariance[np.ix_(own, own)] + chosen.scale.floor**2 * np.eye(chosen.size)
    return Finding(chosen, values[own], honest, decision)


@dataclass(frozen=True)
class _Verdict:
    """How well cameras explain held-out tracks."""

    costs: FloatArray
    """(H,) mean robust cost of each track's positions."""
    median_px: float

    def better_than(self, other: _Verdict, config: CameraErrorConfig) -> bool:
        """Whether the mean cost is lower by several σ of the tracks' differences, and the median error by a share."""
        gains = other.costs - self.costs
        certain = gains.mean() > config.min_gain_sigmas * gains.std() / np.sqrt(len(gains))
        return bool(certain) and self.median_px < (1 - config.min_gain) * other.median_px


@dataclass(frozen=True)
class _Judge:
    """Held-out tracks, triangulated again with each path."""

    scene: Scene
    tracks: Tracks
    triangulation: TriangulationConfig

    def __call__(self, problem: Problem, values: FloatArray) -> _Verdict:
        scene = corrected(CameraPath.of(self.scene), problem.errors, values).on(self.scene)
        errors_px = np.linalg.norm(
            reprojection_px(scene, self.tracks, triangulate(scene, self.tracks, self.triangulation)), axis=1
        )
        cost = np.log1p((errors_px / self.tracks.sigma_px[self.tracks.track]) ** 2)
        lengths = np.bincount(self.tracks.track)
        return _Verdict(np.bincount(self.tracks.track, cost) / lengths, float(np.median(errors_px[errors_px > 0])))
