"""Stage 4: the factors between planes (contact edges, doors in walls, right angles) and the priors on them."""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import P

from gtlayout.config import EstimationConfig
from gtlayout.evidence import TYPICAL_DEPTH, Evidence
from gtlayout.factors import coplanarity_factor, edge_factor, perpendicularity_factor, plane_prior_factor
from gtlayout.scene import FloatArray, IntArray


def structure_factors(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> gtsam.NonlinearFactorGraph:
    """Edges, coplanarity and right angles among the surfaces that have a plane in (S, 4) ``planes`` (NaN = none)."""
    graph = gtsam.NonlinearFactorGraph()
    noise = gtsam.noiseModel
    placed = np.isfinite(planes[:, 0])
    edge_noise = noise.Robust.Create(
        noise.mEstimator.Cauchy.Create(config.edge_cauchy),
        noise.Diagonal.Sigmas(np.array([config.sigma_edge_shift_px, config.sigma_edge_tilt_px])),
    )
    for group in evidence.edges:
        a, b = group.surfaces
        if placed[a] and placed[b]:
            camera = group.camera
            projection = camera.K @ np.column_stack([camera.R_cam_from_world, camera.t_cam_from_world])
            graph.add(edge_factor((P(a), P(b)), group.representatives_px(), projection, edge_noise))
    in_wall = noise.Robust.Create(
        noise.mEstimator.Cauchy.Create(config.coplanarity_cauchy),
        noise.Diagonal.Sigmas(np.array([*[config.sigma_coplanarity_angle] * 3, config.sigma_recess])),
    )
    for a in np.nonzero((evidence.host >= 0) & placed)[0].tolist():
        host = int(evidence.host[a])
        points, _ = evidence.views[a].seen_on(planes[host])
        if len(points):
            graph.add(coplanarity_factor((P(a), P(host)), np.median(points, axis=0), in_wall))
    right_angle = noise.Isotropic.Sigma(1, config.sigma_perpendicularity)
    for a, b in _right_angles(evidence, planes, config).tolist():
        graph.add(perpendicularity_factor((P(a), P(b)), right_angle))
    return graph


def plane_priors(
    evidence: Evidence, planes: FloatArray, sigma_depths: float, config: EstimationConfig
) -> gtsam.NonlinearFactorGraph:
    """A prior on every plane that only matters where nothing else does: σ of d is so many depths of the surface."""
    graph = gtsam.NonlinearFactorGraph()
    for s in np.nonzero(np.isfinite(planes[:, 0]))[0].tolist():
        _, depth = evidence.views[s].seen_on(planes[s])
        sigma_d = sigma_depths * (float(np.median(depth)) if len(depth) else TYPICAL_DEPTH)
        sigmas = np.array([config.sigma_prior_normal, config.sigma_prior_normal, sigma_d])
        graph.add(plane_prior_factor(P(s), planes[s], gtsam.noiseModel.Diagonal.Sigmas(sigmas)))
    return graph


def _right_angles(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> IntArray:
    """(R, 2) surfaces to hold at right angles: walls to floor and ceiling (paper 3.3), and walls nearly so already.

    The paper has no such term between walls; a weak one steadies those that little else holds, odd angles escape it.
    """
    sine = np.abs(planes[:, :3] @ planes[:, :3].T)
    walls = np.outer(evidence.wall, evidence.wall) & (sine < config.right_angle_reach)
    return np.argwhere(np.triu(np.isfinite(sine) & (evidence.perpendicular | walls)))
