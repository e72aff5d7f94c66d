"""The evidence beside a layout, what would help each plane, and what to do next, on rooms that need no solve."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rooms
import shapely
from room_dimensions import room_dimensions
from solved_rooms import CENTER, WIDE, solved

from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.instances import Plane, Support
from gtlayout.layout import Layout
from gtlayout.planes.trail import EvidenceAlone, PlaneTrail
from gtlayout.quality.assess import Quality, assess
from gtlayout.report.crops import ASPECT, window
from gtlayout.report.help import Viewpoints, helps
from gtlayout.report.next_steps import folded_reasons, next_steps
from gtlayout.report.panels import panels
from gtlayout.results.evidence import EdgeSeen, EvidenceSeen, TracksSeen
from gtlayout.results.evidence_file import evidence_text, read_evidence
from gtlayout.results.names import EVIDENCE_FILE
from gtlayout.review.findings import Finding
from gtlayout.scene import Scene

FLOOR, CEILING, LEFT, RIGHT, FAR = range(5)
ASIDE = rooms.level_camera((3.4, 0.6, 1.25), focal=200.0, width=640, height=480)
UNKNOWN = EvidenceAlone("right angles", 2, np.nan, np.nan, 0.5, 1.5, 0.2, 2)


class Room:
    """The box room in two drawings and one frame more, with planes as uncertain as the test wants them."""

    def __init__(self, sigmas: dict[int, float], others: tuple[Any, ...] = (ASIDE,), support: Support | None = None):
        solution = solved([WIDE, rooms.level_camera(CENTER, focal=220.0, width=640, height=480)], others)
        self.scene: Scene = solution.scene
        planes = tuple(self._plane(plane, sigmas.get(i, 0.005)) for i, plane in enumerate(solution.planes))
        if support is not None:
            planes = tuple(replace(plane, support=support) for plane in planes)
        joint = np.zeros((20, 20))
        for i, plane in enumerate(planes):
            joint[4 * i : 4 * i + 4, 4 * i : 4 * i + 4] = plane.covariance
        extents = solution.layout.extents
        self.layout: Layout = replace(
            solution.layout,
            planes=planes,
            dimensions=room_dimensions(solution.instances, planes, extents, joint),
        )
        self.quality: Quality = assess(self.scene, solution.instances, planes, extents, Config().quality)
        middles = [shapely.get_coordinates(extent.region.centroid) for extent in extents]
        tracks = EvidenceAlone("tracks", 30, 0.012, 0.02, 0.4, 0.6, 1.0, 3)
        self.seen = EvidenceSeen(
            tuple(
                PlaneTrail(extent.frame.to_world(middle)[0], (tracks, UNKNOWN))
                for extent, middle in zip(extents, middles, strict=True)
            ),
            (TracksSeen(0, FAR, np.array([[300.0, 200.0], [310, 210], [320, 220]]), np.array([0.02, 0.3, 0.98])),),
            (self.edge(1.0),),
        )

    @staticmethod
    def _plane(plane: Plane, sigma: float) -> Plane:
        return replace(plane, covariance=sigma**2 * np.diag([0.0, 0.0, 0.0, 1.0]))

    @staticmethod
    def edge(misfit_px: float, used: bool = True) -> EdgeSeen:
        drawn = np.array([[220.0, 330.0], [420.0, 330.0]])
        return EdgeSeen(1, (FLOOR, FAR), drawn, drawn + np.array([0.0, misfit_px]), misfit_px, used)

    def with_edge(self, edge: EdgeSeen) -> EvidenceSeen:
        return replace(self.seen, edges=(edge,))

    def helps(self, i: int, seen: EvidenceSeen | None = None) -> list[str]:
        return helps(self.scene, self.layout, self.quality, seen or self.seen, i, Viewpoints.of(self.scene))


@pytest.fixture(scope="module")
def known() -> Room:
    return Room({})


@pytest.fixture(scope="module")
def weak() -> Room:
    """Its far wall may be 40 cm off."""
    return Room({FAR: 0.4, CEILING: 0.25})


def test_evidence_is_read_back_as_it_was(known: Room, tmp_path: Path) -> None:
    assert read_evidence(tmp_path, known.scene, known.layout) is None
    text = evidence_text(known.scene, known.layout, known.seen)
    (tmp_path / EVIDENCE_FILE).write_text(text)
    read = read_evidence(tmp_path, known.scene, known.layout)
    assert read is not None
    assert evidence_text(known.scene, known.layout, read) == text
    assert np.isnan(read.trails[0].alone[1].offset)
    assert read.trails[0].alone[0] == known.seen.trails[0].alone[0]
    np.testing.assert_allclose(read.trails[FAR].middle, known.seen.trails[FAR].middle, rtol=1e-5)
    (edge,), (tracks,) = read.edges, read.tracks
    assert (edge.key_frame, edge.instances, edge.misfit_px, edge.used) == (1, (FLOOR, FAR), 1.0, True)
    assert (tracks.key_frame, tracks.instance, tracks.weight.tolist()) == (0, FAR, [0.02, 0.3, 0.98])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda data: data.update(format="x"), "is no evidence"),
        (lambda data: data["planes"].pop(), "of another layout"),
        (lambda data: data.pop("tracks"), "damaged or of other annotations"),
        (lambda data: data["tracks"][0].update(image="other.png"), "damaged or of other annotations"),
        (lambda data: data["tracks"][0]["weight"].pop(), "is damaged"),
        (lambda data: data["tracks"][0].update(x_px=[1, None, 3]), "is damaged"),
        (lambda data: data["tracks"][0].update(x_px={"a": 1}), "is damaged"),
        (lambda data: data["edges"][0].update(drawn_px=[1, 2]), "is damaged"),
        (lambda data: data["edges"][0].update(instances=["floor_0"]), "is damaged"),
        (lambda data: data["planes"][0]["alone"][0].update(freedom=4), "is damaged"),
        (lambda data: data["planes"][0]["alone"][0].update(measurements=10**400), "is damaged"),
        (lambda data: data["planes"][0].update(middle=[10**400, 0, 0]), "is damaged"),
        (lambda data: data.update(planes=[3]), "is damaged"),
    ],
)
def test_damaged_evidence_is_one_clear_line(
    known: Room, tmp_path: Path, change: Callable[[Any], object], says: str
) -> None:
    data = json.loads(evidence_text(known.scene, known.layout, known.seen))
    change(data)
    (tmp_path / EVIDENCE_FILE).write_text(json.dumps(data))
    with pytest.raises(GtlayoutError, match=says) as caught:
        read_evidence(tmp_path, known.scene, known.layout)
    assert "\n" not in str(caught.value)
    assert EVIDENCE_FILE in str(caught.value)


def test_what_is_known_and_agrees_needs_no_help(known: Room) -> None:
    assert [known.helps(i) for i in range(5)] == [[], [], [], [], []]


def test_an_edge_that_lies_off_is_named_with_its_frame(known: Room) -> None:
    (line,) = known.helps(FLOOR, known.with_edge(known.edge(12.0)))
    assert line.startswith("Redraw the edge of floor_0 with wall_4 in 1.png: it lies 12 px")
    assert known.helps(FAR, known.with_edge(known.edge(12.0)))[0].startswith("Redraw the edge of wall_4 with floor_0")
    assert known.helps(LEFT, known.with_edge(known.edge(12.0))) == []
    assert known.helps(FLOOR, known.with_edge(known.edge(12.0, used=False))) == [], "the solve took it for no contact"
    assert known.helps(FLOOR, known.with_edge(known.edge(4.0))) == []


def test_tracks_that_lie_off_are_named() -> None:
    room = Room({}, support=Support(tracks=20, outvoted=0.7))
    assert room.helps(FAR) == ["Look at the visible parts of wall_4: 70 % of the tracks on them lie off the plane."]


def test_a_weak_plane_is_drawn_from_aside_or_measured(weak: Room) -> None:
    aside, tape = weak.helps(CEILING)
    assert aside.startswith("Draw x0.png, too: it shows ceiling_1 from ")
    assert float(aside.split(" from ")[1].split("°")[0]) > 10
    # σ 25 cm; the floor's 5 mm and the tape's 3 mm stay.
    assert tape == "Measure from ceiling_1 to floor_0 by tape: its σ would fall from 25.0 to about 0.6 cm."
    # Nothing lies opposite the far wall.
    assert [line.split(":")[0] for line in weak.helps(FAR)] == ["Draw x0.png, too"]
    no_unit = replace(weak.layout, metric=False)
    assert len(helps(weak.scene, no_unit, weak.quality, weak.seen, CEILING, Viewpoints.of(weak.scene))) == 1


def test_a_frame_that_cannot_see_it_is_not_proposed() -> None:
    behind = rooms.level_camera((3.4, 5.5, 1.25), focal=200.0, width=640, height=480)
    near = rooms.level_camera((2.02, 0.6, 1.25), focal=200.0, width=640, height=480)
    for others in ((), (behind,), (near,)):
        (line,) = Room({FAR: 0.4}, others).helps(FAR)
        assert line.startswith("Film wall_4 again with more motion along it: no other frame")
    # The left wall stands between this camera and the far wall.
    outside = rooms.level_camera((-2.0, 2.5, 1.25), focal=60.0, width=640, height=480)
    (line,) = Room({FAR: 0.4}, (outside,)).helps(FAR)
    assert line.startswith("Film wall_4 again")


def test_a_plane_that_nothing_places_is_to_be_drawn_more_often(known: Room) -> None:
    room = Room({FAR: 0.4})
    trails = [*room.seen.trails]
    trails[FAR] = PlaneTrail(np.full(3, np.nan), ())
    lines = room.helps(FAR, replace(room.seen, trails=tuple(trails)))
    assert lines == ["Draw wall_4 in more frames, with the instances that it meets: nothing places it yet."]


def finding(kind: Any, key_frame: int, element: int | None, severity: float = 0.2) -> Finding:
    where = np.array([[100.0, 100.0], [150.0, 120.0]])
    drawn = None if element is None else f"e{element}"
    return Finding(key_frame, f"{key_frame}.png", drawn, None, kind, f"what is wrong with {drawn}", severity, where)


def test_the_next_steps_are_three_at_most_and_name_nothing_twice(weak: Room) -> None:
    findings = [
        finding("label", 0, LEFT),
        finding("edge", 1, LEFT),  # the same wall in another frame
        finding("shape", 1, RIGHT),
        finding("shape", 0, FLOOR),
        finding("gap", 0, None, 0.002),
    ]
    steps = next_steps(weak.scene, weak.layout, weak.quality, findings, weak.seen)
    assert [step.title for step in steps] == [
        "Look at the label of wall e2 in 0.png",
        "Redraw wall e3 in 1.png",
        "Draw x0.png, too",
    ]
    assert steps[0].why == "What is wrong with e2."
    assert steps[0].drawn == "100.0,100.0 150.0,120.0"
    assert "ceiling_1 is weak: depth uncertain" in steps[2].why, "the weak plane that covers most of what is drawn"
    assert steps[2].outline.startswith("M")
    # Gaps that hardly matter come when there is room.
    (only,) = next_steps(weak.scene, weak.layout, replace(weak.quality, instances=()), findings[-1:], None)
    assert only.title == "Fill a gap in 0.png"


def test_an_element_that_does_not_fit_is_a_step_unless_the_scene_is_trusted(known: Room) -> None:
    assert next_steps(known.scene, known.layout, known.quality, (), known.seen) == []
    elements = tuple(replace(one, iou=0.3) if one.instance == RIGHT else one for one in known.quality.elements)
    wrong = replace(known.quality, elements=elements)
    assert next_steps(known.scene, known.layout, wrong, (), known.seen) == []
    checked = replace(wrong, headline=replace(wrong.headline, word="check"))
    (step,) = next_steps(known.scene, known.layout, checked, (), known.seen)
    assert step.title == "Redraw wall_3 = e3 in 0.png"
    assert "IoU of only 0.30" in step.why


def test_a_scene_without_depth_is_filmed_again_first(weak: Room) -> None:
    blind = replace(weak.quality, known_share=0.2)
    first, *_ = next_steps(weak.scene, weak.layout, blind, [finding("label", 0, LEFT)], weak.seen)
    assert first.title == "Film again with more motion sideways, or give better cameras"
    assert "only 20 %" in first.why


def test_reasons_are_said_once_for_all_whom_they_concern(weak: Room) -> None:
    (depth,) = folded_reasons(weak.layout, weak.quality)
    assert (depth["reason"], depth["names"]) == ("depth uncertain by more than 3 %", ["ceiling_1", "wall_4"])
    instances = list(weak.quality.instances)
    instances[FAR] = replace(instances[FAR], reason=instances[FAR].reason + "; IoU below 0.8", causes=("a", "b"))
    both = folded_reasons(weak.layout, replace(weak.quality, instances=tuple(instances)))
    assert [one["reason"] for one in both] == ["depth uncertain by more than 3 %", "IoU below 0.8"]
    assert both[1]["causes"] == ["wall_4: a, b"]


def test_a_panel_says_what_each_kind_says(weak: Room) -> None:
    colors = ["#000000"] * 5
    panel = panels(weak.scene, weak.layout, weak.quality, weak.seen, colors)[FAR]
    assert (panel["name"], panel["verdict"], panel["says"]) == ("wall_4", "weak", "all evidence agrees")
    assert panel["joint"]["sigma"] == "40.0 cm"
    tracks, angles = panel["kinds"]
    assert (tracks["offset"], tracks["sigma"], tracks["chi2"], tracks["agrees"]) == ("+1.2 cm", "2.0 cm", "1.0", True)
    assert (angles["offset"], angles["bar"], angles["tilt"]) == ("–", None, "0.50°")
    assert panel["joint"]["bar"] == {"middle": 50.0, "low": 0.0, "width": 100.0}
    assert tracks["bar"] == {"middle": 51.5, "low": 49.0, "width": 5.0}
    first, second = panel["views"]
    assert [first[name] for name in ("on", "beside", "off")] == ["M320 220h0", "M310 210h0", "M300 200h0"]
    assert (first["edges"], len(second["edges"])) == ([], 1)
    assert second["edges"][0]["title"] == "floor_0 – wall_4: 1.0 px"
    against = replace(weak.seen.trails[FAR].alone[0], chi2=99.0)
    trails = (*weak.seen.trails[:FAR], PlaneTrail(weak.seen.trails[FAR].middle, (against, UNKNOWN)))
    panel = panels(weak.scene, weak.layout, weak.quality, replace(weak.seen, trails=trails), colors)[FAR]
    assert panel["says"] == "disagreement: tracks against the rest"
    assert panel["kinds"][0]["agrees"] is False
    no_unit = panels(weak.scene, replace(weak.layout, metric=False), weak.quality, weak.seen, colors)[FAR]
    assert no_unit["kinds"][0]["offset"] == "+0.012 u"


def test_a_window_holds_what_is_shown_and_lies_in_the_image() -> None:
    for shown in (shapely.box(10, 10, 20, 20), shapely.box(0, 0, 640, 100), shapely.box(600, 400, 700, 500)):
        x, y, width, height = map(float, window(WIDE, shown).split())
        assert width / height == pytest.approx(ASPECT, rel=0.01)
        assert width >= 0.34 * 640
        inside = shown.intersection(shapely.box(0, 0, 640, 480))
        assert shapely.box(x - 1, y - 1, x + width + 1, y + height + 1).contains(inside)
        assert x >= -0.5 and x + width <= 641
    assert window(WIDE, shapely.Point()) == "0 0 640 480"
    assert window(WIDE, shapely.box(900, 900, 910, 910)) == "0 0 640 480"
