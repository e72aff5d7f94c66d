"""The review of all drawings of a solved scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import Polygon
from threadpoolctl import threadpool_limits

from gtlayout.geometry.polygons import polygons
from gtlayout.regrouping.drawings import KeyFrameMatch, match_key_frames
from gtlayout.review.config import ReviewConfig
from gtlayout.review.contacts import contact_findings
from gtlayout.review.findings import Finding, named, worst_first
from gtlayout.review.matches import match_findings, missing_instances
from gtlayout.review.tiling import tiling_findings
from gtlayout.solution import Solution


def review(solution: Solution, config: ReviewConfig | None = None) -> tuple[Finding, ...]:
    """What is probably wrong in the drawings, the worst first.

    Each key frame is compared with what all others predict in it, its contact edges with planes solved without them;
    curved walls are not.
    """
    # As in a solve: the same bytes need one thread.
    with threadpool_limits(limits=1, user_api="blas"):
        return _reviewed(solution, config or ReviewConfig())


def _reviewed(solution: Solution, config: ReviewConfig) -> tuple[Finding, ...]:
    settings = solution.config
    matches = match_key_frames(
        solution.scene, solution.instances, solution.planes, settings.regrouping, settings.extent
    )
    missing = missing_instances(solution, matches, config)
    curved = _curved_elements(solution)
    matched = [
        finding
        for found, unseen in zip(matches, missing, strict=True)
        for finding in match_findings(solution, found, unseen, config)
        if (finding.key_frame, finding.element_id) not in curved
    ]
    by_key_frame = {found.key_frame: found for found in matches}
    tiling = [
        finding if finding.kind != "gap" else _explained(finding, solution, by_key_frame.get(finding.key_frame))
        for finding in tiling_findings(solution.scene, config)
        if finding.kind != "gap" or not _is_missing(finding, matched)
    ]
    return worst_first([*matched, *tiling, *contact_findings(solution, matches, config)])


def _curved_elements(solution: Solution) -> set[tuple[int, str]]:
    """(key frame, element) of curved walls: what the others predict of these is flat."""
    return {
        (k, solution.scene.key_frames[k].elements[e].id)
        for i in solution.layout.curved
        for k, e in solution.instances[i].members
    }


def _is_missing(gap: Finding, matched: Sequence[Finding]) -> bool:
    """Whether what is known to be missing from the drawing lies in most of a gap."""
    missing = [one for one in matched if one.kind == "missing" and one.key_frame == gap.key_frame]
    region = shapely.union_all([Polygon(), *(polygons(Polygon(one.where_px)) for one in missing)])
    outline = polygons(Polygon(gap.where_px))
    return bool(outline.intersection(region).area > outline.area / 2)


def _explained(gap: Finding, solution: Solution, found: KeyFrameMatch | None) -> Finding:
    """A gap with the element that fills most of it in all other key frames, if there is one."""
    if found is None:
        return gap
    outline = polygons(Polygon(gap.where_px))
    share = [outline.intersection(found.prediction.visible[i]).area / outline.area for i in found.own]
    e = int(np.argmax(share))
    if share[e] <= 0.5:
        return gap
    element = solution.scene.key_frames[found.key_frame].elements[e]
    message = (
        f"gap of {gap.severity:.1%} of the image, by the other key frames a part of {named(element)}: draw it as that"
    )
    return replace(gap, element_id=element.id, message=message)
