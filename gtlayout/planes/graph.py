"""Stage 4, second half: the factor graph and Levenberg-Marquardt with re-weighted tracks. Local world throughout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, O, P

from gtlayout.factors import track_factor
from gtlayout.instances import ContactOffsets
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import contact_offsets
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.reflections import reflected
from gtlayout.planes.structural_factors import met, plane_priors, structure_factors
from gtlayout.scene import BoolArray, Camera, FloatArray, IntArray
from gtlayout.tracking.tracks import Tracks, spread_observations

_BATCH = 32
"""Landmarks per track factor: GTSAM copies all values for every Python factor it calls, and a big batch is a dense
clique.
"""
_NEGLIGIBLE = 1e-3
"""Tracks of less weight stay out of the graph."""


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
    planes, landmarks = start.copy(), np.full((len(tracks), 3), np.nan)
    costs: list[float] = []
    history = [planes.copy()]
    for looseness in (*config.annealing, *[1.0] * config.rounds):
        kernels = replace(
            config, track_cauchy=looseness * config.track_cauchy, edge_cauchy=looseness * config.edge_cauchy
        )
        robust, weight = track_weights(evidence, planes, kernels)
        used = weight > _NEGLIGIBLE
        values = _values(evidence, planes, landmarks, placed, np.nonzero(used)[0], config)
        offsets = contact_offsets(evidence, planes, kernels)
        for c in met(evidence, start):
            values.insertPoint3(O(c), offsets[c])
        seen = observed & used[tracks.track]
        graph = _track_factors(cameras, tracks, evidence, values, placed, seen, weight, config)
        graph.push_back(structure_factors(evidence, start, kernels))
        for prior in plane_priors(evidence, start, config.sigma_start_depths, config):
            graph.push_back(prior)
        values = _optimise(graph, values, placed, start, config, costs, history)
        before, planes = planes, history[-1].copy()
        landmarks[:] = np.nan
        for n in np.nonzero(used)[0]:
            landmarks[n] = values.atPoint3(L(int(n)))
        if looseness == 1.0 and np.abs(planes - before)[placed].max() < config.converged_below:
            break
    return Optimum(planes, landmarks, {}, robust, tuple(costs), tuple(history))


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


def _track_factors(
    cameras: Sequence[Camera],
    tracks: Tracks,
    evidence: Evidence,
    values: gtsam.Values,
    placed: IntArray,
    observed: BoolArray,
    weight: FloatArray,
    config: EstimationConfig,
) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    noise = gtsam.noiseModel
    pinholes = {int(f): _pinhole(cameras[f]) for f in np.unique(tracks.frame[observed])}
    cauchy = noise.mEstimator.Cauchy.Create(config.observation_cauchy)
    sigmas = tracks.sigma_px / np.sqrt(np.maximum(weight, _NEGLIGIBLE))
    models = [noise.Robust.Create(cauchy, noise.Isotropic.Sigma(2, sigma)) for sigma in sigmas]
    for n, f, point_px in zip(
        tracks.track[observed].tolist(), tracks.frame[observed].tolist(), tracks.points_px[observed], strict=True
    ):
        graph.add(gtsam.TriangulationFactorCal3_S2(pinholes[f], point_px, models[n], L(n), False, False))
    # A track that its own observations contradict can diverge to infinity. The weak priors keep the system regular.
    weak_prior = noise.Isotropic.Sigma(3, config.sigma_prior_point)
    for n in np.unique(tracks.track[observed]).tolist():
        graph.add(gtsam.PriorFactorPoint3(L(n), values.atPoint3(L(n)), weak_prior))
    for s in placed:
        members = np.nonzero((evidence.track_instance == s) & (weight > _NEGLIGIBLE))[0]
        for batch in np.split(members, range(_BATCH, len(members), _BATCH)):
            if len(batch):
                keys = [L(int(n)) for n in batch]
                graph.add(track_factor(P(int(s)), keys, config.sigma_relief / np.sqrt(weight[batch])))
    return graph


def _pinhole(camera: Camera) -> gtsam.PinholeCameraCal3_S2:
    K = camera.K
    pose = gtsam.Pose3(gtsam.Rot3(camera.R_cam_from_world.T), camera.center_world)
    return gtsam.PinholeCameraCal3_S2(pose, gtsam.Cal3_S2(K[0, 0], K[1, 1], K[0, 1], K[0, 2], K[1, 2]))


def _values(
    evidence: Evidence,
    planes: FloatArray,
    landmarks: FloatArray,
    placed: IntArray,
    used: IntArray,
    config: EstimationConfig,
) -> gtsam.Values:
    """Planes as given; landmarks where they were, or else where their ray meets their plane.

    A landmark whose ray misses the plane starts on its ray, within the depths that an instance may have. From hundreds
    of depths away one landmark turned its plane by 84°, with or without a robust kernel on their distance.
    """
    values = gtsam.Values()
    for s in placed:
        values.insert(P(int(s)), gtsam.OrientedPlane3(planes[s]))
    rays = evidence.rays
    on_plane, depth = evidence.on_planes(used, planes[evidence.track_instance[used]])
    meets = (depth > config.depth_range[0]) & (depth < config.depth_range[1])
    off_plane = rays.center[used] + np.clip(1 / rays.rho[used], *config.depth_range)[:, None] * rays.ray[used]
    on_plane = np.where(meets[:, None], on_plane, off_plane)
    for n, point in zip(used.tolist(), np.where(np.isfinite(landmarks[used]), landmarks[used], on_plane), strict=True):
        values.insertPoint3(L(n), point)
    return values


def _optimise(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    placed: IntArray,
    start: FloatArray,
    config: EstimationConfig,
    costs: list[float],
    history: list[FloatArray],
) -> gtsam.Values:
    """Levenberg-Marquardt, one iteration at a time, so that each can be recorded."""
    params = gtsam.LevenbergMarquardtParams()
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, params)
    error = optimizer.error()
    if not costs:  # the start is part of the history
        costs.append(error)
    for _ in range(config.max_iterations):
        optimizer.iterate()
        costs.append(optimizer.error())
        planes = np.full_like(start, np.nan)
        for s in placed:
            planes[s] = optimizer.values().atOrientedPlane3(P(int(s))).planeCoefficients()
        history.append(planes)
        if error - costs[-1] < config.relative_decrease * error:
            break
        error = costs[-1]
    return optimizer.values()
