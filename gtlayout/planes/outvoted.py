"""Stage 4, before the graph: wrong contacts that fit, because planes have given way to them.

Where an annotator forgot an occlusion edge in every key frame, or a cupboard hides the foot and the corner of a wall, a
few wrong contacts can agree, and turn a plane away from its tracks. These weigh no more than a few edges, because
their errors are not independent, and are outvoted. So it is tried whether all else fits better without a contact that
costs much; and, where nearly all tracks of an instance lie on one plane but another was found, without those contacts
that do not fit the plane of the tracks. Points that agree so well are not wrong by chance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import Pair, contact_misfits_px
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.initialization import initial_planes
from gtlayout.planes.objective import contact_costs, cost_of, track_cost, wrong_contact_prices
from gtlayout.planes.starts import polish
from gtlayout.scene import FloatArray

Candidate = tuple[frozenset[Pair], FloatArray]
"""Contacts to drop, and (S, 4) planes to start from without them."""


def without_outvoting(
    evidence: Evidence, dropped: frozenset[Pair], planes: FloatArray, config: EstimationConfig, seed: int
) -> tuple[Evidence, FloatArray]:
    """Evidence without the contacts that outvote all else, and the (S, 4) planes polished on it.

    Args:
        evidence: All that there is.
        dropped: Pairs whose contacts are known to be wrong.
        planes: (S, 4) polished on the evidence without these, NaN = not placed.
    """
    judged = replace(config, max_track_weight=config.judged_track_weight)
    of_tracks = planes_of_tracks(evidence, config, seed)
    cost = _cost(evidence, dropped, planes, judged)
    while True:
        tried = [
            (_cost(evidence, without, polished, judged), number, without, polished)
            for number, (without, start) in enumerate(
                [
                    *_without_one(evidence, dropped, planes, judged),
                    *_on_their_tracks(evidence, dropped, planes, of_tracks, judged),
                ]
            )
            for polished in [polish(evidence.without(without), start, config)]
        ]
        best = min(tried, key=lambda candidate: candidate[:2], default=None)
        if best is None or best[0] > cost - config.min_gain_without:
            return evidence.without(dropped), planes
        cost, _, dropped, planes = best


def planes_of_tracks(evidence: Evidence, config: EstimationConfig, seed: int) -> FloatArray:
    """(S, 4) the plane of each instance by its own tracks alone; NaN where these do not lie on one plane."""
    count = len(evidence.views)
    alone = replace(
        evidence,
        edges=(),
        perpendicular=np.zeros((count, count), dtype=bool),
        wall=np.zeros(count, dtype=bool),
        host=np.full(count, -1),
    )
    planes = polish(alone, initial_planes(alone, config.depth_range, config.initialization, seed), config)
    for s in np.nonzero(np.isfinite(planes[:, 0]))[0].tolist():
        index, weight = evidence.tracks_of(s, config.max_track_weight)
        on_plane = np.abs(evidence.track_residuals(index, planes[s][None])[0]) < config.agreeing_track
        if weight == 0.0 or on_plane.mean() < config.min_agreeing_share:
            planes[s] = np.nan
    return planes


def _without_one(
    evidence: Evidence, dropped: frozenset[Pair], planes: FloatArray, config: EstimationConfig
) -> Iterator[Candidate]:
    """Without one more of the contacts that cost much."""
    kept, prices = evidence.without(dropped), wrong_contact_prices(evidence, config)
    costs = contact_costs(kept, planes, config)
    for pair in kept.contacts:
        if costs[pair] > config.doubted_share * prices[pair]:
            yield dropped | {pair}, planes


def _on_their_tracks(
    evidence: Evidence, dropped: frozenset[Pair], planes: FloatArray, of_tracks: FloatArray, config: EstimationConfig
) -> Iterator[Candidate]:
    """With one plane turned back to that of its tracks, without the contacts that do not fit it there."""
    kept = evidence.without(dropped)
    for s in np.nonzero(np.isfinite(planes[:, 0]) & np.isfinite(of_tracks[:, 0]))[0].tolist():
        outvoted = track_cost(evidence, s, planes[s], config) - track_cost(evidence, s, of_tracks[s], config)
        if outvoted < config.wrong_contact_price:
            continue
        start = planes.copy()
        start[s] = of_tracks[s]
        misfits_px = contact_misfits_px(kept, start, config)
        wrong = {pair for pair, misfit in misfits_px.items() if s in pair and misfit > config.max_contact_px}
        if wrong:
            yield dropped | wrong, start


def _cost(evidence: Evidence, dropped: frozenset[Pair], planes: FloatArray, config: EstimationConfig) -> float:
    """Of (S, 4) planes that were solved without some contacts, in a comparison of several such choices."""
    prices = wrong_contact_prices(evidence, config)
    kept = cost_of(evidence.without(dropped), planes, config, prices)
    return kept.total + sum(prices[pair] for pair in sorted(dropped))
