"""What to do next, at most three things: from the review of the drawings, the verdict, and planes that are weak."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from gtlayout.figures import figure
from gtlayout.layout import Layout
from gtlayout.quality.assess import Quality
from gtlayout.quality.config import QualityConfig
from gtlayout.report.crops import line, window
from gtlayout.report.frames import path_of
from gtlayout.report.help import Viewpoints, helps, worst_edge
from gtlayout.results.evidence import EvidenceSeen
from gtlayout.review.findings import Finding, FindingKind, named
from gtlayout.scene import Scene

MOST = 3
_DRAWINGS = 2
"""So many wrong drawings before what else there is."""
_SMALL_GAP = 0.01
"""Of the image."""
_ASKS: dict[FindingKind, str] = {
    "another place": "Redraw {element} in {frame}: drawn for another frame?",
    "label": "Look at the label of {element} in {frame}",
    "missing": "Draw what is missing in {frame}",
    "overlap": "Part the elements that overlap in {frame}",
    "edge": "Move an edge of {element} in {frame}",
    "occlusion edge missing": "Draw an occlusion edge in {frame}",
    "shape": "Redraw {element} in {frame}",
    "gap": "Fill a gap in {frame}",
}


@dataclass(frozen=True)
class Step:
    """Something to do, and where to look."""

    title: str
    """What to do, in a line."""
    why: str
    key_frame: int
    window: str
    """The part of the key frame to look at, as an SVG's ``viewBox``."""
    outline: str = ""
    """SVG path of the element that it is about."""
    drawn: str = ""
    """Points of the line to look at, as drawn."""
    expected: str = ""
    """Points of where it should be."""


def next_steps(
    scene: Scene, layout: Layout, quality: Quality, findings: Sequence[Finding], seen: EvidenceSeen | None
) -> list[Step]:
    """The most important first: what the whole scene lacks, the worst drawings, elements that do not fit, weak planes,
    further drawings, and last gaps that hardly matter.

    No element and no instance is named twice.
    """
    drawings = list(_from_findings(scene, layout, [one for one in findings if not _is_small(one)]))
    sources: tuple[tuple[Iterable[tuple[set[object], Step]], int], ...] = (
        (_whole_scene(scene, layout, quality), MOST),
        (drawings, _DRAWINGS),
        (_misfits(scene, layout, quality), MOST),
        (_weak_planes(scene, layout, quality, seen) if seen is not None else (), MOST),
        (drawings, MOST),
        (_from_findings(scene, layout, [one for one in findings if _is_small(one)]), MOST),
    )
    steps: list[Step] = []
    named_already: set[object] = set()
    for source, most in sources:
        taken = 0
        for about, step in source:
            if len(steps) == MOST or taken == most:
                break
            if named_already.isdisjoint(about):
                named_already |= about
                steps.append(step)
                taken += 1
    return steps


def _is_small(finding: Finding) -> bool:
    return finding.kind == "gap" and finding.severity < _SMALL_GAP


def _whole_scene(scene: Scene, layout: Layout, quality: Quality) -> Iterator[tuple[set[object], Step]]:
    if quality.known_share < QualityConfig().min_known_share:
        whole = window(scene.frame_of(quality.worst_frame).camera, shapely.Point())
        yield (
            {"scene"},
            Step(
                "Film again with more motion sideways, or give better cameras",
                f"Depth is known for only {100 * quality.known_share:.0f} % of what is drawn.",
                quality.worst_frame,
                whole,
            ),
        )


def _from_findings(scene: Scene, layout: Layout, findings: Sequence[Finding]) -> Iterator[tuple[set[object], Step]]:
    instance_of = {member: i for i, instance in enumerate(layout.instances) for member in instance.members}
    for number, one in enumerate(findings):
        elements = scene.key_frames[one.key_frame].elements
        e = next((e for e, element in enumerate(elements) if element.id == one.element_id), None)
        what = "the drawing" if e is None else named(elements[e])
        about: set[object] = {("finding", number)} if e is None else {(one.key_frame, e), instance_of[one.key_frame, e]}
        lines = [
            LineString(points) for points in (one.where_px, one.expected_px) if points is not None and len(points) > 1
        ]
        shown: BaseGeometry = shapely.union_all(lines) if lines else shapely.Point()
        yield (
            about,
            Step(
                _ASKS[one.kind].format(element=what, frame=one.frame_name),
                f"{one.message[:1].upper()}{one.message[1:]}.",
                one.key_frame,
                window(scene.frame_of(one.key_frame).camera, shown),
                drawn=line(one.where_px),
                expected="" if one.expected_px is None else line(one.expected_px),
            ),
        )


def _misfits(scene: Scene, layout: Layout, quality: Quality) -> Iterator[tuple[set[object], Step]]:
    """Elements that the layout does not cover as drawn, where the scene is not to be trusted."""
    if quality.headline.word == "trust":
        return
    least = QualityConfig().accept_iou
    for one in sorted(quality.elements, key=lambda one: one.iou):
        if one.iou < least and quality.instances[one.instance].verdict != "unobservable":
            element, frame = scene.key_frames[one.key_frame].elements[one.element], scene.frame_of(one.key_frame)
            yield (
                {(one.key_frame, one.element), one.instance},
                Step(
                    f"Redraw {layout.instances[one.instance].name} = {element.id} in {frame.name}",
                    f"The layout covers it with an IoU of only {figure(one.iou, 2)}: its outline or its place in the "
                    "room is not what the other frames say.",
                    one.key_frame,
                    window(frame.camera, element.amodal),
                    outline=path_of(element.amodal),
                ),
            )


def _weak_planes(
    scene: Scene, layout: Layout, quality: Quality, seen: EvidenceSeen
) -> Iterator[tuple[set[object], Step]]:
    """Those that cover most of what is drawn first."""
    views = Viewpoints.of(scene)
    weak = [i for i, one in enumerate(quality.instances) if one.verdict != "ok"]
    for i in sorted(weak, key=lambda i: -quality.instances[i].drawn_share):
        advice = helps(scene, layout, quality, seen, i, views)
        if not advice:
            continue
        title, _, rest = advice[0].partition(": ")
        judged, edge = quality.instances[i], worst_edge(scene, seen, i)
        members = layout.instances[i].members
        k, e = max(members, key=lambda member: scene.key_frames[member[0]].elements[member[1]].amodal.area)
        if edge is not None:
            k, e = next(((k, e) for k, e in members if k == edge.key_frame), (k, e))
        element = scene.key_frames[k].elements[e]
        lines = (line(edge.drawn_px), line(edge.expected_px)) if edge is not None and k == edge.key_frame else ("", "")
        about = judged.reason + (f" ({', '.join(judged.causes)})" if judged.causes else "")
        yield (
            {(k, e), i},
            Step(
                title,
                f"{rest[:1].upper()}{rest[1:]} {layout.instances[i].name} is {judged.verdict}: {about}.",
                k,
                window(scene.frame_of(k).camera, element.amodal),
                path_of(element.amodal),
                *lines,
            ),
        )


def folded_reasons(layout: Layout, quality: Quality) -> list[dict[str, object]]:
    """Why instances are not ok, each reason once with all whom it concerns; causes of each instance beside.

    Reasons that concern most of what is drawn come first.
    """
    by_reason: dict[str, list[int]] = {}
    for i, judged in enumerate(quality.instances):
        for reason in judged.reason.split("; ") if judged.reason else ():
            by_reason.setdefault(reason, []).append(i)

    def share(of: list[int]) -> float:
        return float(np.sum([quality.instances[i].drawn_share for i in of]))

    return [
        {
            "reason": reason,
            "names": [layout.instances[i].name for i in of],
            "causes": [
                f"{layout.instances[i].name}: {', '.join(quality.instances[i].causes)}"
                for i in of
                if quality.instances[i].causes
            ],
        }
        for reason, of in sorted(by_reason.items(), key=lambda item: -share(item[1]))
    ]
