"""What tracks, edges, right angles and priors say of all planes, linearised at the optimum."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, O, P, S

from gtlayout.factors import biased_depth_factor
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import contact_offsets
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.linear_system import (
    ANGLE,
    EDGE,
    JOINT,
    OFFSET,
    PRIOR,
    SHARED_DEPTH,
    LinearSystem,
    SystemBuilder,
)
from gtlayout.planes.reflections import reflected
from gtlayout.planes.structural_factors import (
    edge_factors,
    met,
    offset_priors,
    opening_factors,
    plane_priors,
    right_angle_factors,
)
from gtlayout.scene import FloatArray, IntArray
from gtlayout.tracking.tracks import Tracks

_MIRRORED = 0.5
"""Tracks that are mirror images with more than this probability say nothing of their surface."""


def linearise(
    tracks: Tracks, evidence: Evidence, planes: FloatArray, placed: IntArray, config: EstimationConfig
) -> LinearSystem:
    """Tracks without their landmarks, the biases of instances and key frames, and all that joins planes.

    Args:
        planes: (S, 4) where to linearise.
        placed: (P,) the instances that have a plane.
    """
    system = SystemBuilder()
    observations = np.bincount(tracks.track, minlength=len(tracks))
    for s in placed.tolist():
        system.add_root(P(s), gtsam.OrientedPlane3(planes[s]))
    offsets = contact_offsets(evidence, planes, config)
    for c in met(evidence, planes):
        a, b = evidence.contacts[c]
        system.add_link(O(c), offsets[c], (P(a), P(b)))
    for s in placed.tolist():
        _add_tracks(system, observations, evidence, s, planes[s], config)
    # Robust weights are for the scales to decide.
    quadratic = replace(
        config, edge_cauchy=np.inf, coplanarity_cauchy=np.inf, right_angle_cauchy=np.inf, upright_cauchy=np.inf
    )
    system.add(edge_factors(evidence, planes, quadratic), EDGE)
    system.add(offset_priors(evidence, planes, config), OFFSET)
    system.add([factor for _, factor in opening_factors(evidence, planes, quadratic)], JOINT)
    system.add(right_angle_factors(evidence, planes, quadratic), ANGLE)
    system.add(plane_priors(evidence, planes, config.sigma_prior_depths, config), PRIOR)
    return system.build()


def _add_tracks(
    system: SystemBuilder,
    observations: IntArray,
    evidence: Evidence,
    s: int,
    plane: FloatArray,
    config: EstimationConfig,
) -> None:
    """What the tracks of instance ``s`` say of its plane, and how far they may be off together.

    Args:
        observations: (N,) how often each track was observed.
    """
    expected = config.uncertainty
    index = np.nonzero((evidence.track_instance == s) & (evidence.track_weight > 0))[0]
    points, depth = evidence.on_planes(index, plane)
    kept = depth > 0
    residual = evidence.track_residuals(index, plane[None])[0]
    kept &= reflected(residual, evidence.relative_sigma(index, residual), 1.0, config) < _MIRRORED
    index, points, depth = index[kept], points[kept], depth[kept]
    if len(index) == 0:
        return
    # Surfaces of which few points survive (mirrors, gloss) are off by more.
    trust = np.sqrt(max(float(evidence.track_weight[index].max()), expected.min_trust))
    over = np.column_stack([np.ones(len(index)), _over_plane(points, plane)])
    rays = evidence.rays
    raw = rays.sigma_rho[index] * depth
    # Observations of a track share errors: it knows no more than so many of them would.
    sigma = raw * np.sqrt(np.maximum(observations[index] / config.independent_observations, 1.0))
    sigma = np.hypot(sigma, config.sigma_relief / np.median(depth))
    point, isotropic = np.zeros(3), gtsam.noiseModel.Isotropic.Sigma
    shared = isotropic(3, expected.shared_bias_ratio * expected.relative_depth / trust)
    system.add_branch(S(s), point, P(s))
    system.add([gtsam.PriorFactorPoint3(S(s), point, shared)], SHARED_DEPTH)
    _, group = np.unique(evidence.track_key_frame[index], return_inverse=True)
    biases = np.hypot(expected.relative_depth, expected.share_of_track_sigma * _medians(raw, group)) / trust
    for number, bias in enumerate(biases.tolist()):
        here = group == number
        key = B(len(system.leaves))
        system.add_leaf(key, point, S(s))
        system.add([gtsam.BetweenFactorPoint3(S(s), key, point, isotropic(3, bias))], SHARED_DEPTH)
        members, per_depth = index[here], 1 / depth[here]
        factor = biased_depth_factor(
            (P(s), key),
            rays.center[members],
            rays.ray[members],
            rays.rho[members],
            over[here] * per_depth[:, None],
            gtsam.noiseModel.Diagonal.Sigmas(sigma[here] * per_depth),
        )
        system.add_tracks(factor, members, sigma[here] * per_depth)


def _over_plane(points: FloatArray, plane: FloatArray) -> FloatArray:
    """(n, 2) where points lie on a plane, from their middle, in units of their spread."""
    uv = (points - np.median(points, axis=0)) @ gtsam.Unit3(plane[:3]).basis()
    return uv / max(float(np.sqrt(np.mean(np.sum(uv**2, axis=1)))), 1e-9)


def _medians(values: FloatArray, group: IntArray) -> FloatArray:
    """(G,) median of the (n,) values in each of G groups, none of them empty."""
    ordered, size = values[np.lexsort((values, group))], np.bincount(group)
    first = np.cumsum(size) - size
    return (ordered[first + (size - 1) // 2] + ordered[first + size // 2]) / 2
