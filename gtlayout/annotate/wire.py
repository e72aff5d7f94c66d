"""From solutions, proposals and findings to the JSON that the page takes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.annotate.advice import Advice, position_sigma
from gtlayout.annotate.outdated import is_outdated
from gtlayout.annotate.shapes import DECIMALS, rings_px
from gtlayout.annotate.solver import LEAST_FRAMES, Solved, State
from gtlayout.colors import sigma_full
from gtlayout.geometry.depth import median_depth
from gtlayout.proposals.proposal import Proposal, ProposedElement
from gtlayout.report.plain import finite
from gtlayout.report.room_view import room_view
from gtlayout.review.findings import Finding
from gtlayout.scene import OPENINGS, Element, FloatArray, KeyFrame

SAME_SHARE = 0.5
"""A proposed element is drawn already when so much of it lies on drawn ones of its kind."""

SAME_PX = 0.02
"""Corners are rounded to half of that."""


def state_json(state: State, drawn: Sequence[KeyFrame] | None) -> dict[str, Any]:
    """What the solver does, without the room itself. ``drawn`` is what the file holds now; None when it is damaged."""
    solved = state.solved
    return {
        "at_work": state.at_work,
        "problem": state.problem,
        "warnings": list(state.warnings),
        "advice": [_advice(one) for one in state.advice],
        "next_frames": list(state.next_frames),
        "solved": None if solved is None else _summary(solved),
        "findings": [] if solved is None else _findings(solved, drawn),
    }


def room_json(solved: Solved) -> dict[str, Any] | None:
    """The room in 3D, as the report has it, with σ of each plane; None for a room without any area."""
    scene, layout = solved.solution.scene, solved.solution.layout
    if len(layout.triangles.faces) == 0:
        return None
    full = sigma_full(layout.metric, median_depth(scene, layout.instances, layout.planes))
    room = room_view(scene, layout, full)
    sigma = {
        instance.name: finite(position_sigma(plane, extent))
        for instance, plane, extent in zip(layout.instances, layout.planes, layout.extents, strict=True)
    }
    return {**room, "position_sigma": sigma, "number": solved.number}


def proposal_json(proposal: Proposal, drawn: Sequence[Element]) -> dict[str, Any]:
    """A proposal as an entry of annotations.json, without what is ``drawn`` already; per element its edges, too."""
    left = [proposed for proposed in proposal.elements if not _is_drawn(proposed.element, drawn)]
    return {
        "elements": [_proposed(proposed) for proposed in left],
        "occlusion_edges": [_points(line) for line in proposal.occlusion_edges] if left else [],
        "uncovered": rings_px(proposal.uncovered),
    }


def _summary(solved: Solved) -> dict[str, Any]:
    solution = solved.solution
    quality, scene = solution.quality, solution.scene
    return {
        "number": solved.number,
        "full": solved.full,
        "seconds": round(solved.seconds, 2),
        "word": quality.headline.word if len(scene.key_frames) >= LEAST_FRAMES else "",
        "iou": finite(quality.iou),
        "ious": {str(scene.key_frames[k].frame): finite(iou) for k, iou in enumerate(quality.frames)},
    }


def _advice(one: Advice) -> dict[str, Any]:
    return {"text": one.text, "frame": one.frame, "enough": one.enough}


def _findings(solved: Solved, drawn: Sequence[KeyFrame] | None) -> list[dict[str, Any]]:
    frames = solved.solution.scene.frames
    before, now = (
        {frames[one.frame].name: one for one in key_frames}
        for key_frames in (solved.reviewed, solved.reviewed if drawn is None else drawn)
    )
    return [
        {
            **_finding(one),
            "outdated": is_outdated(one, before.get(one.frame_name), now.get(one.frame_name)),
        }
        for one in solved.findings
    ]


def _finding(one: Finding) -> dict[str, Any]:
    return {
        "frame": one.frame_name,
        "element": one.element_id,
        "message": one.message,
        "where": _points(one.where_px),
        "expected": None if one.expected_px is None else _points(one.expected_px),
    }


def _proposed(proposed: ProposedElement) -> dict[str, Any]:
    element, edges = proposed.element, proposed.edges
    rings = rings_px(element.amodal)
    corners = np.array([corner for ring in rings for corner in ring])
    starts = np.array([edge.start_px for edge in edges]).reshape(-1, 2)
    # Where a hole was cut open, or a needle removed, edges cannot be told.
    edges = edges if corners.shape == starts.shape and np.allclose(corners, starts, atol=SAME_PX) else ()
    return {
        "id": element.id,
        "label": element.label,
        "polygons": rings,
        "visible": rings_px(element.visible),
        "edges": [
            {
                "confidence": round(edge.confidence, 3),
                "unsnapped": None if edge.unsnapped_px is None else _points(edge.unsnapped_px),
            }
            for edge in edges
        ],
    }


def _is_drawn(element: Element, drawn: Iterable[Element]) -> bool:
    same_kind = [one.amodal for one in drawn if (one.label in OPENINGS) == (element.label in OPENINGS)]
    on_drawn = element.amodal.intersection(shapely.union_all([MultiPolygon(), *same_kind]))
    return bool(on_drawn.area > SAME_SHARE * element.amodal.area)


def _points(line: FloatArray) -> list[list[float]]:
    rounded: list[list[float]] = np.asarray(line, dtype=np.float64).reshape(-1, 2).round(DECIMALS).tolist()
    return rounded
