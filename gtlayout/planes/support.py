"""Stage 4, after the solve: what each plane is solved from, in figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtlayout.instances import EvidenceKind, Support
from gtlayout.planes.edge_group import EdgeGroup
from gtlayout.planes.evidence import Evidence, followed
from gtlayout.planes.graph import Optimum
from gtlayout.prepared.measurements import Measurements
from gtlayout.scene import BoolArray, FloatArray
from gtlayout.tracking.triangulation import parallax_deg

OUTVOTED = 0.1
"""Tracks of less robust weight are outvoted: with Cauchy's kernel those off by more than three times its scale."""


def supports(
    measured: Measurements, evidence: Evidence, solution: Optimum, dominant_evidence: Sequence[EvidenceKind]
) -> tuple[Support, ...]:
    """The support of each instance's plane. ``evidence`` and ``solution`` are local."""
    scene, tracks = measured.scene, measured.tracks
    parallax = parallax_deg(scene, tracks, measured.rays)
    placed = np.isfinite(solution.planes[:, 0])
    edges = [(g, _distance_px(g, solution.planes)) for g in evidence.edges if placed[list(g.instances)].all()]
    given_up: BoolArray = solution.robust_weight < OUTVOTED
    found = []
    for s, instance in enumerate(measured.instances):
        own: BoolArray = evidence.track_instance == s
        kept, tried = followed(scene, tracks, instance)
        gaps = [gap for group, gap in edges if s in group.instances]
        found.append(
            Support(
                tracks=int(np.count_nonzero(own)),
                survived=kept / tried if tried else np.nan,
                parallax_deg=float(np.median(parallax[own])) if own.any() else np.nan,
                outvoted=float(np.mean(given_up[own])) if own.any() and placed[s] else np.nan,
                contact_edges=len(gaps),
                edge_px=float(np.median(gaps)) if gaps else np.nan,
                dominant_evidence=dominant_evidence[s],
            )
        )
    return tuple(found)


def _distance_px(group: EdgeGroup, planes: FloatArray) -> float:
    """Median distance of a contact edge's points from the line in which its planes meet; infinite when they do not."""
    return float(np.median(np.abs(group.misfits_px(planes))))
