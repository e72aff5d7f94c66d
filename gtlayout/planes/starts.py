"""Stage 4: the best of a few starts, each polished on a small graph without landmarks and judged by its cost.

The search is random, and in some scenes one search ends in a wrong basin. The cost shows which: with all settings
tried on the real clips the start of lowest cost was the right one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import O, P

from gtlayout.factors import depth_factor
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import contact_offsets
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.initialization import initial_planes
from gtlayout.planes.objective import cost_of
from gtlayout.planes.structural_factors import met, plane_priors, structure_factors
from gtlayout.scene import FloatArray


def best_start(
    evidence: Evidence, config: EstimationConfig, seed: int, searched: Callable[[], None] = lambda: None
) -> FloatArray:
    """(S, 4) polished planes of the cheapest of ``config.starts`` searches; NaN for an instance without evidence.

    ``searched`` is called after each search.
    """
    ranked = []
    for number in range(config.starts):
        search = config.initialization
        if number % 2:
            # Mirror images outvote edges when there are many of them: half of the searches trust tracks less.
            search = replace(search, max_track_weight=search.max_track_weight / 4)
        planes = polish(evidence, initial_planes(evidence, config.depth_range, search, seed + number), config)
        unplaced = int(np.count_nonzero(np.isnan(planes[:, 0])))
        ranked.append((unplaced, cost_of(evidence, planes, config).total, number, planes))
        searched()
    return min(ranked, key=lambda candidate: candidate[:3])[3]


def polish(evidence: Evidence, start: FloatArray, config: EstimationConfig) -> FloatArray:
    """(S, 4) all planes, optimised on tracks reduced to inverse depths."""
    placed = np.nonzero(np.isfinite(start[:, 0]))[0].tolist()
    graph = structure_factors(evidence, start, config)
    for prior in plane_priors(evidence, start, config.sigma_start_depths, config):
        graph.push_back(prior)
    values = gtsam.Values()
    offsets = contact_offsets(evidence, start, config)
    for c in met(evidence, start):
        values.insertPoint3(O(c), offsets[c])
    for s in placed:
        values.insert(P(s), gtsam.OrientedPlane3(start[s]))
        index, weight = evidence.tracks_of(s, config.max_track_weight)
        if weight > 0:
            scalar = gtsam.noiseModel.mEstimator.Base.ReweightScheme.Scalar
            noise = gtsam.noiseModel.Robust.Create(
                gtsam.noiseModel.mEstimator.Cauchy.Create(config.track_cauchy * np.sqrt(weight), scalar),
                gtsam.noiseModel.Diagonal.Sigmas(evidence.sigma_rho[index] / np.sqrt(weight)),
            )
            rays = evidence.rays
            graph.add(depth_factor(P(s), rays.center[index], rays.ray[index], rays.rho[index], noise))
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(config.max_iterations)
    params.setRelativeErrorTol(config.relative_decrease)
    values = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    planes = np.full_like(start, np.nan)
    for s in placed:
        planes[s] = values.atOrientedPlane3(P(s)).planeCoefficients()
    return planes
