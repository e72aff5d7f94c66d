"""Stage 4, before the graph: wrong contacts are removed.

Where an annotator left out an occlusion edge, two instances of which one hides the other seem to touch, in every key
frame that shows both. Such edges are too many and too consistent for a robust kernel. But the contact fits no planes
that all other evidence supports. So the pair of instances that fits worst is removed, until all others fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import contact_offsets
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.starts import best_start, polish
from gtlayout.scene import FloatArray

Pair = tuple[int, int]


def start_without_wrong_contacts(
    evidence: Evidence, config: EstimationConfig, seed: int
) -> tuple[Evidence, FloatArray]:
    """Evidence without the contact edges of pairs that disagree with all others, and (S, 4) starting planes for it."""
    dropped: frozenset[Pair] = frozenset()
    tried = set()
    while True:
        kept = _without(evidence, dropped)
        planes = best_start(kept, config, seed)
        tried.add(dropped)
        fit = _misfits_px(evidence, planes, config)
        dropped = frozenset(
            pair for pair in dropped if fit.get(pair, np.inf) > config.readmitted_share * config.max_contact_px
        )
        dropped |= _disagreeing(_without(evidence, dropped), planes, config)
        if dropped in tried or len(tried) == config.contact_searches:
            return kept, planes


def without_wrong_contacts(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> Evidence:
    """Evidence without the contact edges of pairs that disagree with all others, for (S, 4) planes near the optimum."""
    return _without(evidence, _disagreeing(evidence, planes, config))


def all_contacts_fit(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> bool:
    """Whether no contact edge is further than it may be from where two of (S, 4) ``planes`` meet."""
    return all(misfit <= config.max_contact_px for misfit in _misfits_px(evidence, planes, config).values())


def _disagreeing(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> frozenset[Pair]:
    """The worst pair, then the worst of the others without it, and so on until all fit."""
    dropped: frozenset[Pair] = frozenset()
    while True:
        kept = _without(evidence, dropped)
        planes = polish(kept, planes, config)
        fit = {
            pair: misfit for pair, misfit in _misfits_px(kept, planes, config).items() if not _all_there_is(kept, pair)
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


def _without(evidence: Evidence, dropped: frozenset[Pair]) -> Evidence:
    return replace(evidence, edges=tuple(group for group in evidence.edges if group.instances not in dropped))


def _misfits_px(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> dict[Pair, float]:
    """Of each pair whose planes are known the root mean square distance of its edge from their line, moved by their
    offset, as of an image of 640x480: the median over the key frames.
    """
    offsets = dict(zip(evidence.contacts, contact_offsets(evidence, planes, config), strict=True))
    found: dict[Pair, list[float]] = {}
    for group in evidence.edges:
        if np.isfinite(planes[list(group.instances), 0]).all():
            distance_px = group.annotation_px(group.misfits_px(planes, offsets[group.instances]))
            found.setdefault(group.instances, []).append(float(np.sqrt(np.mean(distance_px**2))))
    return {pair: float(np.median(distances)) for pair, distances in found.items()}
