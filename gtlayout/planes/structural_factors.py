"""Stage 4: the factors between planes (contact edges, doors in walls, right angles) and the priors on them."""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import O, P

from gtlayout.factors import coplanarity_factor, edge_factor, perpendicularity_factor, plane_prior_factor
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.evidence import Evidence
from gtlayout.scene import FloatArray, IntArray
from gtlayout.tracking.normalisation import TYPICAL_DEPTH


def structure_factors(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> gtsam.NonlinearFactorGraph:
    """All factors between planes, for the instances that have one in (S, 4) ``planes`` (NaN = none)."""
    graph = gtsam.NonlinearFactorGraph()
    openings = [factor for _, factor in opening_factors(evidence, planes, config)]
    for factors in (
        edge_factors(evidence, planes, config),
        offset_priors(evidence, planes, config),
        openings,
        right_angle_factors(evidence, planes, config),
    ):
        for factor in factors:
            graph.push_back(factor)
    return graph


def met(evidence: Evidence, planes: FloatArray) -> list[int]:
    """Numbers of the contacts of which both planes are placed."""
    return [c for c, pair in enumerate(evidence.contacts) if np.isfinite(planes[list(pair), 0]).all()]


def offset_priors(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> list[gtsam.NonlinearFactor]:
    """One for each contact whose planes are placed."""
    noise = gtsam.noiseModel.Isotropic.Sigma(3, config.sigma_contact_offset)
    return [gtsam.PriorFactorPoint3(O(c), np.zeros(3), noise) for c in met(evidence, planes)]


def edge_factors(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> list[gtsam.NonlinearFactor]:
    """One for each annotated contact edge."""
    sigmas_px = np.array([config.sigma_edge_shift_px, config.sigma_edge_tilt_px])
    factors: list[gtsam.NonlinearFactor] = []
    number = {pair: c for c, pair in enumerate(evidence.contacts)}
    for group in evidence.edges:
        if np.isfinite(planes[list(group.instances), 0]).all():
            noise = _cauchy(group.camera.annotation_scale * sigmas_px, config.edge_cauchy)
            keys = P(group.instances[0]), P(group.instances[1])
            factors.append(edge_factor(keys, O(number[group.instances]), group.seen, noise))
    return factors


def right_angle_factors(
    evidence: Evidence, planes: FloatArray, config: EstimationConfig
) -> list[gtsam.NonlinearFactor]:
    """One for each two instances that should be at right angles."""
    factors: list[gtsam.NonlinearFactor] = []
    sigma = np.array([config.sigma_perpendicularity])
    upright, between_walls = _cauchy(sigma, config.upright_cauchy), _cauchy(sigma, config.right_angle_cauchy)
    for a, b in _right_angles(evidence, planes, config).tolist():
        both_walls = evidence.wall[a] and evidence.wall[b]
        factors.append(perpendicularity_factor((P(a), P(b)), between_walls if both_walls else upright))
    return factors


def opening_factors(
    evidence: Evidence, planes: FloatArray, config: EstimationConfig
) -> list[tuple[tuple[int, int], gtsam.NonlinearFactor]]:
    """A factor for each door or window and its host, with the indices of the two."""
    in_wall = _cauchy(np.array([*[config.sigma_coplanarity_angle] * 3, config.sigma_recess]), config.coplanarity_cauchy)
    factors: list[tuple[tuple[int, int], gtsam.NonlinearFactor]] = []
    for a in np.nonzero((evidence.host >= 0) & np.isfinite(planes[:, 0]))[0].tolist():
        host = int(evidence.host[a])
        points, _ = evidence.views[a].seen_on(planes[host])
        if len(points):
            factor = coplanarity_factor((P(a), P(host)), np.median(points, axis=0), in_wall)
            factors.append(((a, host), factor))
    return factors


def _cauchy(sigmas: FloatArray, scale: float) -> gtsam.noiseModel.Base:
    """Independent errors, robust beyond ``scale`` σ; Gaussian when that is infinite."""
    gaussian = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    if np.isinf(scale):
        return gaussian
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(scale), gaussian)


def plane_priors(
    evidence: Evidence, planes: FloatArray, sigma_depths: float, config: EstimationConfig
) -> list[gtsam.NonlinearFactor]:
    """A weak prior on every plane, with an effect only without evidence. σ of d is in depths of the instance."""
    factors: list[gtsam.NonlinearFactor] = []
    for s in np.nonzero(np.isfinite(planes[:, 0]))[0].tolist():
        _, depth = evidence.views[s].seen_on(planes[s])
        sigma_d = sigma_depths * (float(np.median(depth)) if len(depth) else TYPICAL_DEPTH)
        sigmas = np.array([config.sigma_prior_normal, config.sigma_prior_normal, sigma_d])
        factors.append(plane_prior_factor(P(s), planes[s], gtsam.noiseModel.Diagonal.Sigmas(sigmas)))
    return factors


def _right_angles(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> IntArray:
    """(R, 2) instances to hold at right angles: walls to floor and ceiling (paper 3.3), and walls nearly so already.

    The paper has no such term between walls. A weak one stabilises walls with little other evidence, and does not force
    odd angles.
    """
    sine = np.abs(planes[:, :3] @ planes[:, :3].T)
    walls = np.outer(evidence.wall, evidence.wall) & (sine < config.right_angle_reach)
    return np.argwhere(np.triu(np.isfinite(sine) & (evidence.perpendicular | walls)))
