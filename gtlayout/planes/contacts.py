"""Stage 4, before the graph: wrong contacts are removed.

Where an annotator left out an occlusion edge, two instances of which one hides the other seem to touch, in every key
frame that shows both. Such edges are too many and too consistent for a robust kernel. But the contact fits no planes
that all other evidence supports. So the pair of instances that fits worst is removed, until all others fit.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import Pair, contact_misfits_px
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.outvoted import without_outvoting
from gtlayout.planes.starts import best_start, polish
from gtlayout.scene import FloatArray


def start_without_wrong_contacts(
    evidence: Evidence, config: EstimationConfig, seed: int, searched: Callable[[], None] = lambda: None
) -> tuple[Evidence, FloatArray]:
    """Evidence without the contact edges of pairs that disagree with all others, and (S, 4) starting planes for it.

    ``searched`` is called after each search for a start.
    """
    dropped: frozenset[Pair] = frozenset()
    tried = set()
    while True:
        planes = best_start(evidence.without(dropped), config, seed, searched)
        tried.add(dropped)
        fit = contact_misfits_px(evidence, planes, config)
        wrong = frozenset(
            pair for pair in dropped if fit.get(pair, np.inf) > config.readmitted_share * config.max_contact_px
        )
        wrong |= _disagreeing(evidence.without(wrong), planes, config)
        if wrong in tried or len(tried) == config.contact_searches:
            return without_outvoting(evidence, dropped, planes, config, seed)
        dropped = wrong


def near_start_without_wrong_contacts(
    evidence: Evidence, planes: FloatArray, config: EstimationConfig, seed: int
) -> tuple[Evidence, FloatArray]:
    """The same, from (S, 4) planes near the optimum, which stay where all contacts fit."""
    if all(misfit <= config.max_contact_px for misfit in contact_misfits_px(evidence, planes, config).values()):
        return evidence, planes
    return without_outvoting(evidence, _disagreeing(evidence, planes, config), planes, config, seed)


def _disagreeing(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> frozenset[Pair]:
    """The worst pair, then the worst of the others without it, and so on until all fit."""
    dropped: frozenset[Pair] = frozenset()
    while True:
        kept = evidence.without(dropped)
        planes = polish(kept, planes, config)
        fit = {
            pair: misfit
            for pair, misfit in contact_misfits_px(kept, planes, config).items()
            if not _all_there_is(kept, pair)
        }
        worst = max(fit, key=lambda pair: fit[pair], default=None)
        if worst is None or fit[worst] <= config.max_contact_px:
            return dropped
        dropped |= {worst}


def _all_there_is(evidence: Evidence, pair: Pair) -> bool:
    """Whether this contact is the only evidence of one of the pair, so that nothing contradicts it.

    Doors and windows have their walls, and walls their doors and windows.
    """
    return any(
        np.count_nonzero(evidence.touching[s]) == 1
        and not (evidence.track_weight[evidence.track_instance == s] > 0).any()
        and evidence.host[s] < 0
        and s not in evidence.host
        for s in pair
    )
