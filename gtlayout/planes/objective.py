"""Stage 4: the cost of planes, with the same terms for all planes that are compared.

The graphs in which planes are polished and solved leave out terms, depending on where their planes start: two walls at
odd angles have no right angle, planes that coincide have no line in which they meet. That is right for a solve, but not
for a comparison, in which the worst planes would cost least. Here every term always counts, and each is bounded.
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import P

from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import contact_offsets
from gtlayout.planes.edge_group import EdgeGroup
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.initialization import manhattan_sine
from gtlayout.planes.structural_factors import opening_factors
from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class Cost:
    """Negative log-likelihoods up to a constant."""

    total: float
    by_instance: FloatArray
    """(S,) sum of the terms of an instance; terms of two instances count for both. NaN without a plane."""


def cost_of(evidence: Evidence, planes: FloatArray, config: EstimationConfig, prices: FloatArray | None = None) -> Cost:
    """The cost of (S, 4) ``planes``, NaN = not placed.

    Priors do not count, because each start has its own. With (S, S) ``prices`` no contact costs more than its price.
    """
    placed = np.isfinite(planes[:, 0])
    own = np.zeros(len(planes))
    pairs = contact_costs(evidence, planes, config)
    if prices is not None:
        pairs = np.minimum(pairs, prices)
    for s in np.nonzero(placed)[0].tolist():
        own[s] = track_cost(evidence, s, planes[s], config) + _of_absurd_depths(evidence, s, planes[s], config)
    values = gtsam.Values()
    for s in np.nonzero(placed)[0].tolist():
        values.insert(P(s), gtsam.OrientedPlane3(planes[s]))
    for pair, factor in opening_factors(evidence, planes, config):
        pairs[pair] += factor.error(values)
    cosine = planes[:, :3] @ planes[:, :3].T
    both = np.triu(np.outer(placed, placed), k=1)
    upright = evidence.perpendicular & both
    pairs[upright] += cauchy_loss((cosine[upright] / config.sigma_perpendicularity) ** 2, config.upright_cauchy)
    # For each wall all others together count as one, however many there are.
    walls = np.outer(evidence.wall, evidence.wall) & both
    sine = manhattan_sine(cosine[walls], evidence.touching[walls])
    odd = np.minimum(sine, config.right_angle_reach) / config.sigma_perpendicularity
    others = max(int(np.count_nonzero(evidence.wall & placed)) - 1, 1)
    pairs[walls] += 2 / others * cauchy_loss(odd**2, config.right_angle_cauchy)
    by_instance = np.where(placed, own + pairs.sum(axis=0) + pairs.sum(axis=1), np.nan)
    return Cost(float(own.sum() + pairs.sum()), by_instance)


def track_cost(evidence: Evidence, s: int, plane: FloatArray, config: EstimationConfig) -> float:
    """What the tracks of instance ``s`` cost at a (4,) plane."""
    index, weight = evidence.tracks_of(s, config.max_track_weight)
    if weight == 0.0:
        return 0.0
    residual = evidence.track_residuals(index, plane[None])[0]
    return weight * float(cauchy_loss(residual**2, config.track_cauchy).sum())


def contact_costs(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> FloatArray:
    """(S, S) what the contact of each pair costs at (S, 4) planes, in all its key frames; the smaller number first."""
    costs = np.zeros((len(planes), len(planes)))
    placed = np.isfinite(planes[:, 0])
    offsets = dict(zip(evidence.contacts, contact_offsets(evidence, planes, config), strict=True))
    for pair, offset in offsets.items():
        costs[pair] += 0.5 * offset @ offset / config.sigma_contact_offset**2
    for group in evidence.edges:
        if placed[list(group.instances)].all():
            costs[group.instances] += _of_edge(group, planes, offsets[group.instances], config)
    return costs


def wrong_contact_prices(evidence: Evidence, config: EstimationConfig) -> FloatArray:
    """(S, S) what it costs to call the contact of a pair wrong, the smaller number first; infinite without one.

    A wrong line is drawn somewhere, which is paid once, and in each key frame with the usual errors.
    """
    prices = np.full(evidence.touching.shape, np.inf)
    for pair in evidence.contacts:
        frames = sum(group.instances == pair for group in evidence.edges)
        prices[pair] = config.wrong_contact_price + config.usual_edge_cost * frames
    return prices


def cauchy_loss(squared: FloatArray, scale: float) -> FloatArray:
    """GTSAM's Cauchy loss of squared residuals in σ²."""
    return 0.5 * scale**2 * np.log1p(squared / scale**2)


def _of_absurd_depths(evidence: Evidence, s: int, plane: FloatArray, config: EstimationConfig) -> float:
    depth = evidence.views[s].depths(plane[None])
    absurd = (depth < config.depth_range[0]) | (depth > config.depth_range[1])
    return config.initialization.absurd_weight * float(np.mean(absurd))


def _of_edge(group: EdgeGroup, planes: FloatArray, offset: FloatArray, config: EstimationConfig) -> float:
    first, second = group.annotation_px(group.ends.misfits_px(planes, offset))
    shift, tilt = (first + second) / 2, (first - second) / 2
    squared = (shift / config.sigma_edge_shift_px) ** 2 + (tilt / config.sigma_edge_tilt_px) ** 2
    return float(cauchy_loss(squared, config.edge_cauchy))
