"""Stage 4, second half: the factor graph and Levenberg-Marquardt with re-weighted tracks. Local world throughout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import O, P

from gtlayout.instances import ContactOffsets
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import contact_offsets
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.landmarks import Landmarks
from gtlayout.planes.problem import Problem
from gtlayout.planes.reflections import reflected
from gtlayout.planes.structural_factors import met, plane_priors, structure_factors
from gtlayout.scene import Camera, FloatArray, IntArray
from gtlayout.tracking.tracks import Tracks, spread_observations

_NEGLIGIBLE = 1e-3
"""Tracks of less weight stay out of the graph."""
_LEAST_DAMPING, _MOST_DAMPING, _DAMPING_FACTOR = 1e-5, 1e5, 10.0
"""Of Levenberg-Marquardt, added to the information of every unknown."""


@dataclass(frozen=True)
class Optimum:
    """The optimum. S instances, N tracks; NaN for what was not in the graph."""

    planes: FloatArray
    """(S, 4)."""
    landmarks: FloatArray
    """(N, 3)."""
    offsets: ContactOffsets
    """Of all contacts whose planes are placed."""
    robust_weight: FloatArray
    """(N,) weight of each track after the last re-weighting, in [0, 1]."""
    costs: tuple[float, ...]
    """At the start and after each Levenberg-Marquardt iteration. Re-weighting between runs changes them, too."""
    history: tuple[FloatArray, ...]
    """(S, 4) planes at the same times."""


def optimise_graph(
    cameras: Sequence[Camera], tracks: Tracks, evidence: Evidence, start: FloatArray, config: EstimationConfig
) -> Optimum:
    """Optimise from ``start`` (S, 4).

    Whole tracks are re-weighted between runs of Levenberg-Marquardt (Cauchy on a track's deviation from its plane):
    a robust kernel on each factor cannot do that, because a track is many factors.
    """
    placed = np.nonzero(np.isfinite(start[:, 0]))[0]
    observed = spread_observations(tracks, config.max_observations)
    planes, points = start.copy(), np.full((len(tracks), 3), np.nan)
    costs: list[float] = []
    history = [planes.copy()]
    for looseness in (*config.annealing, *[1.0] * config.rounds):
        kernels = replace(
            config, track_cauchy=looseness * config.track_cauchy, edge_cauchy=looseness * config.edge_cauchy
        )
        robust, weight = track_weights(evidence, planes, kernels)
        used = np.nonzero(weight > _NEGLIGIBLE)[0]
        begin = np.where(np.isfinite(points[used]), points[used], _on_plane(evidence, planes, used, config))
        of_plane = evidence.track_instance[used]
        landmarks = Landmarks.of(cameras, tracks, used, observed, of_plane, begin, weight[used], config)
        graph = structure_factors(evidence, start, kernels)
        for prior in plane_priors(evidence, start, config.sigma_start_depths, config):
            graph.push_back(prior)
        values = gtsam.Values()
        for s in placed.tolist():
            values.insert(P(s), gtsam.OrientedPlane3(planes[s]))
        offsets = contact_offsets(evidence, planes, kernels)
        for c in met(evidence, start):
            values.insertPoint3(O(c), offsets[c])
        problem = Problem(graph, landmarks, placed, len(start))
        before = planes
        planes, found = _optimise(problem, values, begin, config, costs, history)
        points[:] = np.nan
        points[used] = found
        if looseness == 1.0 and np.abs(planes - before)[placed].max() < config.converged_below:
            break
    return Optimum(planes, points, {}, robust, tuple(costs), tuple(history))


def track_weights(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> tuple[FloatArray, FloatArray]:
    """(N,) robust weight of each track at ``planes``, and its whole weight in the graph."""
    robust = np.zeros(len(evidence.track_instance))
    weight = np.zeros(len(robust))
    for s in np.nonzero(np.isfinite(planes[:, 0]))[0]:
        index = np.nonzero(evidence.track_instance == s)[0]
        residual = evidence.track_residuals(index, planes[s][None])[0]
        scale = config.track_cauchy * _spread(residual, config)
        robust[index] = 1.0 / (1.0 + (residual / scale) ** 2)
        robust[index] *= 1.0 - reflected(residual, evidence.relative_sigma(index, residual), scale, config)
        weight[index] = robust[index] * evidence.track_weight[index]
        # Tracks of an instance in one key frame share errors of camera and surface. Beyond some number of them, more
        # add no information.
        key_frame = evidence.track_key_frame[index]
        together = np.bincount(key_frame, weight[index])[key_frame]
        weight[index] *= np.minimum(1.0, config.max_track_weight / np.maximum(together, 1e-9))
    return robust, weight


def _spread(residual: FloatArray, config: EstimationConfig) -> float:
    """Standard deviation of an instance's residuals, in σ, from their median: at most the expected one.

    Where tracks agree to a fraction of σ, a track that is one σ off lies on something else: furniture before its wall.
    """
    if len(residual) < config.full_tracks:
        return 1.0
    return float(np.clip(1.4826 * np.median(np.abs(residual)), config.min_spread, 1.0))


def _on_plane(evidence: Evidence, planes: FloatArray, used: IntArray, config: EstimationConfig) -> FloatArray:
    """(n, 3) where the rays of tracks meet their planes.

    A landmark whose ray misses the plane starts on its ray, within the depths that an instance may have. From hundreds
    of depths away one landmark turned its plane by 84°, with or without a robust kernel on their distance.
    """
    rays = evidence.rays
    on_plane, depth = evidence.on_planes(used, planes[evidence.track_instance[used]])
    meets = (depth > config.depth_range[0]) & (depth < config.depth_range[1])
    off_plane = rays.center[used] + np.clip(1 / rays.rho[used], *config.depth_range)[:, None] * rays.ray[used]
    return np.where(meets[:, None], on_plane, off_plane)


def _optimise(
    problem: Problem,
    values: gtsam.Values,
    points: FloatArray,
    config: EstimationConfig,
    costs: list[float],
    history: list[FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """(S, 4) planes and (n, 3) landmarks after Levenberg-Marquardt, each iteration of which is recorded."""
    damping, error = _LEAST_DAMPING, problem.error(values, points)
    if not costs:  # the start is part of the history
        costs.append(error)
    for _ in range(config.max_iterations):
        linear = problem.linearise(values, points)
        while True:
            new_values, new_points = linear.stepped(values, points, damping)
            new_error = problem.error(new_values, new_points)
            if new_error <= error or damping > _MOST_DAMPING:
                break
            damping *= _DAMPING_FACTOR
        if new_error > error:
            break
        values, points, before, error = new_values, new_points, error, new_error
        damping = max(damping / _DAMPING_FACTOR, _LEAST_DAMPING)
        costs.append(error)
        history.append(problem.planes(values))
        if before - error < config.relative_decrease * before:
            break
    return problem.planes(values), points
