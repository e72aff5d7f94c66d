"""The whitened linear system of all planes, linearised at the optimum."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, P, S

from gtlayout.factors import biased_depth_factor
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.structural_factors import edge_factors, joint_factors, plane_priors
from gtlayout.scene import FloatArray, IntArray
from gtlayout.tracking.tracks import Tracks

TRACK, SHARED_DEPTH, EDGE, JOINT, PRIOR = range(5)
"""Families of errors: the first three have a scale that is estimated, the others σ as configured; priors are not
measurements, so none of them can be wrong.
"""


@dataclass(frozen=True)
class LinearSystem:
    """The whitened linear system at the solution: R rows, N unknowns of which the planes' tangents come first."""

    jacobian: FloatArray
    """(R, N)."""
    target: FloatArray
    """(R,) what ``jacobian @ step`` should be."""
    family: IntArray
    """(G,) of each measurement."""
    first: IntArray
    """(G,) its first row: its rows are right or wrong together."""


@dataclass
class _System:
    """A graph in the making, with the family of each measurement."""

    graph: gtsam.NonlinearFactorGraph = field(default_factory=gtsam.NonlinearFactorGraph)
    values: gtsam.Values = field(default_factory=gtsam.Values)
    ordering: gtsam.Ordering = field(default_factory=gtsam.Ordering)
    family: list[int] = field(default_factory=list)
    size: list[int] = field(default_factory=list)

    def insert(self, key: int, start: FloatArray) -> None:
        self.values.insert(key, start)
        self.ordering.push_back(key)

    def add(self, factors: Iterable[gtsam.NonlinearFactor], family: int) -> None:
        for factor in factors:
            self.graph.push_back(factor)
            # Tracks fail one by one, though a factor holds many.
            sizes = [1] * factor.dim() if family == TRACK else [factor.dim()]
            self.size.extend(sizes)
            self.family.extend([family] * len(sizes))

    def linearised(self) -> LinearSystem:
        jacobian, target = self.graph.linearize(self.values).jacobian(self.ordering)
        first = np.cumsum([0, *self.size[:-1]])
        return LinearSystem(jacobian, target, np.array(self.family), first)


def linearise(
    tracks: Tracks, evidence: Evidence, planes: FloatArray, placed: IntArray, config: EstimationConfig
) -> LinearSystem:
    """Tracks without their landmarks, the biases of instances and key frames, and all that joins planes."""
    system = _System()
    for s in placed.tolist():
        system.values.insert(P(s), gtsam.OrientedPlane3(planes[s]))
        system.ordering.push_back(P(s))
    for s in placed.tolist():
        _add_tracks(system, tracks, evidence, s, planes[s], config)
    # The robust weights follow from the scales.
    quadratic = replace(config, edge_cauchy=np.inf, coplanarity_cauchy=np.inf, right_angle_cauchy=np.inf)
    system.add(edge_factors(evidence, planes, quadratic), EDGE)
    system.add(joint_factors(evidence, planes, quadratic), JOINT)
    system.add(plane_priors(evidence, planes, config.sigma_prior_depths, config), PRIOR)
    return system.linearised()


def _add_tracks(
    system: _System, tracks: Tracks, evidence: Evidence, s: int, plane: FloatArray, config: EstimationConfig
) -> None:
    """The tracks of instance ``s``, and the errors that they share."""
    expected = config.uncertainty
    index = np.nonzero((evidence.track_instance == s) & (evidence.track_weight > 0))[0]
    points, depth = evidence.on_planes(index, plane)
    index, points, depth = index[depth > 0], points[depth > 0], depth[depth > 0]
    if len(index) == 0:
        return
    # Instances of which few points survive (mirrors, gloss) have larger errors.
    trust = np.sqrt(max(float(evidence.track_weight[index].max()), expected.least_trust))
    over = np.column_stack([np.ones(len(index)), _over_plane(points, plane)])
    rays = evidence.rays
    raw = rays.sigma_rho[index] * depth
    # Observations of a track share errors, so it counts as no more than this many independent ones.
    observations = np.bincount(tracks.track, minlength=len(tracks))[index]
    sigma = raw * np.sqrt(np.maximum(observations / config.independent_observations, 1.0))
    sigma = np.hypot(sigma, config.sigma_relief / np.median(depth))
    point, isotropic = np.zeros(3), gtsam.noiseModel.Isotropic.Sigma
    shared = isotropic(3, expected.shared_share * expected.relative_depth / trust)
    system.insert(S(s), point)
    system.add([gtsam.PriorFactorPoint3(S(s), point, shared)], SHARED_DEPTH)
    key_frame = evidence.track_key_frame[index]
    for k in np.unique(key_frame).tolist():
        here = key_frame == k
        key = B(s * len(tracks.tried) + k)
        bias = np.hypot(expected.relative_depth, expected.of_track * np.median(raw[here]))
        system.insert(key, point)
        system.add([gtsam.BetweenFactorPoint3(S(s), key, point, isotropic(3, bias / trust))], SHARED_DEPTH)
        members, per_depth = index[here], 1 / depth[here]
        factor = biased_depth_factor(
            (P(s), key),
            rays.center[members],
            rays.ray[members],
            rays.rho[members],
            over[here] * per_depth[:, None],
            gtsam.noiseModel.Diagonal.Sigmas(sigma[here] * per_depth),
        )
        system.add([factor], TRACK)


def _over_plane(points: FloatArray, plane: FloatArray) -> FloatArray:
    """(n, 2) where points lie on a plane, from their middle, in units of their spread."""
    uv = (points - np.median(points, axis=0)) @ gtsam.Unit3(plane[:3]).basis()
    return uv / max(float(np.sqrt(np.mean(np.sum(uv**2, axis=1)))), 1e-9)
