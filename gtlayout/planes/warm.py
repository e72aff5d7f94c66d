"""Stage 4, before the graph, where most planes are known from an earlier solve of nearly the same scene."""

from __future__ import annotations

from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contacts import near_start_without_wrong_contacts
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.initialization import initial_planes
from gtlayout.scene import FloatArray


def warm_start(
    evidence: Evidence, known: FloatArray, config: EstimationConfig, seed: int
) -> tuple[Evidence, FloatArray]:
    """What ``start_without_wrong_contacts`` gives, a search shorter: (S, 4) ``known`` planes, NaN = not known, stay.

    Local world.
    """
    planes = initial_planes(evidence, config.depth_range, config.initialization, seed, known)
    return near_start_without_wrong_contacts(evidence, planes, config, seed)
