"""Why a plane is uncertain, in words for the annotator."""

from __future__ import annotations

from gtlayout.instances import EvidenceKind, Instance, Plane
from gtlayout.quality.config import QualityConfig

_WEAKER: tuple[EvidenceKind, ...] = ("right angles", "contact edges")
"""Evidence less direct than tracks."""


def causes(instance: Instance, plane: Plane, config: QualityConfig) -> tuple[str, ...]:
    """What is wrong with a plane's support, most important first; empty when nothing is.

    First weak kinds of evidence and contradictions, then a lack of tracks, then a lack of edges. A door or window needs
    no contact edge, because it has its wall.
    """
    support = plane.support
    found = []
    if support.dominant_evidence == "priors":
        found.append("nothing but weak priors holds it")
    elif support.dominant_evidence in _WEAKER:
        found.append(f"{'mostly' if support.tracks else 'only'} {support.dominant_evidence} hold it")
    if support.contact_edges and (
        support.outvoted > config.disagreeing_share or support.edge_px > config.disagreeing_edge_px
    ):
        found.append(f"its {'tracks and ' if support.tracks else ''}contact edges disagree")
    if support.tracks == 0:
        found.append("no point on it could be tracked")
    else:
        if support.parallax_deg < config.low_parallax_deg:
            found.append(f"seen under {support.parallax_deg:.1f}° of parallax")
        if support.tracks < config.few_tracks:
            found.append(f"held by {support.tracks} track{'s' if support.tracks > 1 else ''}")
        if support.survived < config.low_survival:
            found.append(f"only {100 * support.survived:.0f} % of the points on it could be followed")
    if support.contact_edges == 0 and instance.host is None:
        found.append("no contact edge")
    return tuple(found)
