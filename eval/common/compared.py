"""A proposal against what a person drew, edge by edge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon

from common.drawn_outlines import SAMPLES, distances_px, inner_edges, matched_elements
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.io.pixels.images import read_depth
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.proposal import Proposal
from gtlayout.scene import Element, FloatArray, Scene
from gtlayout.solution import Solution

INSIDE_PX = 4.0
"""So far beside an edge depth is looked up, …"""
SAME_DEPTH = 0.05
"""… which shows the surface when it differs from that of its plane by this share at most."""
VISIBLE = 0.3
"""Share of an edge that is seen when it counts as visible."""


@dataclass(frozen=True)
class DrawnEdge:
    """One edge that a person drew, not on the border of the image."""

    whole_px: float
    """Largest distance of its points from the proposed outline, as of an image of 640x480; infinite without one."""
    line_px: float
    """Median of the same: where its line is, wherever it ends."""
    visible: bool
    """Measured depth shows the surface beside it; false in scenes without depth."""


@dataclass(frozen=True)
class Compared:
    """A proposal against what a person drew."""

    drawings: int
    """How many key frames were drawn before."""
    iou: FloatArray
    """(N,) of the elements of instances that were drawn before; 0 for those that are not proposed."""
    edges: tuple[DrawnEdge, ...]
    false_elements: int
    visible_px2: tuple[float, float, float]
    """Of the visible parts of all pairs of elements: in common, proposed, drawn."""
    confidence: FloatArray
    """(P,) of the proposed edges that are not on the border …"""
    left: FloatArray
    """(P,) … and whether all of each lies within 5 px of what the person drew: 1 or 0."""


def compare(proposal: Proposal, scene: Scene, drawn: Sequence[int], key_frame: int, whole: Solution) -> Compared:
    """A proposal against the drawing of the key frame that it is for."""
    elements = scene.key_frames[key_frame].elements
    instance_of = {member: i for i, instance in enumerate(whole.instances) for member in instance.members}
    before = {i for (k, _), i in instance_of.items() if k in drawn}
    known = np.array([instance_of.get((key_frame, e), -1) in before for e in range(len(elements))], dtype=bool)
    iou, matched = matched_elements([one.element for one in proposal.elements], elements, same_label=True)
    best = np.array([iou[e, matched[e]] if e in matched else 0.0 for e in range(len(elements))])
    outlines = {e: proposal.elements[q].element.amodal for e, q in matched.items()}
    camera = scene.frame_of(key_frame).camera
    confidence, left = [], []
    person = {q: elements[e].amodal for e, q in matched.items()}
    for q, proposed in enumerate(proposal.elements):
        for edge in proposed.edges:
            if edge.kind != "border":
                points = np.stack([edge.start_px, edge.end_px])
                far = distances_px(points, person[q]).max() if q in person else np.inf
                confidence.append(edge.confidence)
                left.append(float(far <= ProposalConfig().left_px * camera.annotation_scale))
    return Compared(
        len(drawn),
        best[known],
        tuple(drawn_edges(scene, key_frame, outlines, whole)),
        len(proposal.elements) - len(matched),
        _visible_px2([(proposal.elements[q].element, elements[e]) for e, q in matched.items()]),
        np.array(confidence),
        np.array(left),
    )


def _visible_px2(pairs: Sequence[tuple[Element, Element]]) -> tuple[float, float, float]:
    both = sum(proposed.visible.intersection(drawn.visible).area for proposed, drawn in pairs)
    return both, sum(proposed.visible.area for proposed, _ in pairs), sum(drawn.visible.area for _, drawn in pairs)


def drawn_edges(
    scene: Scene, key_frame: int, outlines: Mapping[int, MultiPolygon] | None, whole: Solution
) -> list[DrawnEdge]:
    """The edges of a person's drawing against the outlines proposed for its elements."""
    camera = scene.frame_of(key_frame).camera
    scale = camera.annotation_scale
    edges = []
    for e, element in enumerate(scene.key_frames[key_frame].elements):
        for points in inner_edges(element.amodal, camera):
            distances = distances_px(points, (outlines or {}).get(e, MultiPolygon())) / scale
            seen = outlines is not None and _seen(scene, key_frame, e, points, whole)
            edges.append(DrawnEdge(float(distances.max()), float(np.median(distances)), seen))
    return edges


def _seen(scene: Scene, key_frame: int, element: int, points: FloatArray, whole: Solution) -> bool:
    """Whether the measured depth beside an edge, within its element, is that of the element's plane."""
    frame, outline = scene.frame_of(key_frame), scene.key_frames[key_frame].elements[element].amodal
    instance = next((i for i, one in enumerate(whole.instances) if (key_frame, element) in one.members), None)
    if frame.depth_path is None or instance is None or not whole.planes[instance].observable:
        return False
    depth = read_depth(frame)
    along = points[1] - points[0]
    across = INSIDE_PX * np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    at = points[0] + (np.arange(SAMPLES) + 0.5)[:, None] / SAMPLES * along
    best = 0.0
    for beside in (at + across, at - across):
        inside = shapely.contains_xy(outline, beside)
        inside &= ((beside >= 0) & (beside < [frame.camera.width, frame.camera.height])).all(axis=1)
        measured = depth[tuple(beside[inside].astype(int).T[::-1])]
        inverse = np.column_stack([beside[inside], np.ones(inside.sum())]) @ inverse_depth(
            whole.planes[instance], whole.scene.frame_of(key_frame).camera
        )
        best = max(best, float(np.sum(np.abs(measured * inverse - 1) < SAME_DEPTH)) / SAMPLES)
    return best >= VISIBLE
