"""The review of all drawings of a solved scene."""

from __future__ import annotations

import shapely
from shapely import Polygon

from gtlayout.regrouping.drawings import match_key_frames
from gtlayout.review.config import ReviewConfig
from gtlayout.review.contacts import contact_findings
from gtlayout.review.findings import Finding, worst_first
from gtlayout.review.matches import match_findings
from gtlayout.review.tiling import tiling_findings
from gtlayout.solution import Solution


def review(solution: Solution, config: ReviewConfig | None = None) -> tuple[Finding, ...]:
    """What is probably wrong in the drawings, the worst first.

    Each key frame is compared with what all others predict in it, its contact edges with planes solved without them.
    """
    config = config or ReviewConfig()
    settings = solution.config
    matches = match_key_frames(
        solution.scene, solution.instances, solution.planes, settings.regrouping, settings.extent
    )
    matched = [finding for found in matches for finding in match_findings(solution, found, config)]
    # What is known to be missing explains its gap.
    missing = {
        k: shapely.union_all([Polygon(one.where_px) for one in matched if one.kind == "missing" and one.key_frame == k])
        for k in {one.key_frame for one in matched}
    }
    tiling = [
        one
        for one in tiling_findings(solution.scene, config)
        if one.kind != "gap" or not _explained(Polygon(one.where_px), missing.get(one.key_frame, Polygon()))
    ]
    return worst_first([*matched, *tiling, *contact_findings(solution, matches, config)])


def _explained(gap: Polygon, missing: shapely.Geometry) -> bool:
    return bool(gap.intersection(missing).area > gap.area / 2)
