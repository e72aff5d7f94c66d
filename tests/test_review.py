"""Which drawing is wrong: planted errors are named, right drawings are not suspected, blank areas are let be."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rooms
import shapely
from shapely import MultiPolygon, Polygon

from common.metrics import Metric
from common.solve_again import solve_again
from gtlayout.api import save
from gtlayout.check.annotations import gaps
from gtlayout.cli.app import main
from gtlayout.cli.console import print_findings, stdout
from gtlayout.errors import GtlayoutError
from gtlayout.io.scene_folder import load_scene
from gtlayout.results.names import REVIEW_FILE
from gtlayout.results.review_file import read_review, review_text
from gtlayout.review.config import ReviewConfig
from gtlayout.review.findings import KINDS, Finding, opened, side_along, worst_first
from gtlayout.review.review import review
from gtlayout.review.tiling import tiling_findings
from gtlayout.scene import Element, KeyFrame, Scene
from gtlayout.solution import Solution
from review import is_named, new_findings, pooled
from simulated.wrong_drawings import SHIFTS_PX, WrongDrawing, wrong_drawings


@pytest.fixture(scope="module")
def solution(room_solution: Solution) -> Solution:
    """Of a synthetic room whose drawings are right."""
    return room_solution


@pytest.fixture(scope="module")
def planted(solution: Solution) -> dict[str, WrongDrawing]:
    """One error of each kind."""
    return {wrong.kind: wrong for wrong in wrong_drawings(solution, 1, seed=0)}


@pytest.fixture(scope="module")
def again(solution: Solution, planted: dict[str, WrongDrawing]) -> dict[str, Solution]:
    """The room solved with each of these errors."""
    kinds = "labels swapped", "element left out", *(f"edge shifted by {shift_px:.0f} px" for shift_px in SHIFTS_PX)
    return {kind: solve_again(solution, planted[kind].scene) for kind in kinds}


def test_right_drawings_are_not_suspected(solution: Solution) -> None:
    assert review(solution) == ()


def test_swapped_labels(solution: Solution, planted: dict[str, WrongDrawing], again: dict[str, Solution]) -> None:
    wrong = planted["labels swapped"]
    findings = review(again[wrong.kind])
    assert is_named(wrong, findings)
    said = {one.element_id: one for one in findings if one.kind == "label" and one.key_frame == wrong.key_frame}
    for name in wrong.elements:
        right = next(e for e in solution.scene.key_frames[wrong.key_frame].elements if e.id == name)
        if name in said:
            assert f"{name} is a {right.label} in the other key frames" in said[name].message
    assert said


def test_an_element_left_out(planted: dict[str, WrongDrawing], again: dict[str, Solution]) -> None:
    wrong = planted["element left out"]
    finding, *_ = review(again[wrong.kind])
    assert finding.key_frame == wrong.key_frame
    assert finding.kind == "missing"
    assert finding.element_id is None
    assert "is not drawn" in finding.message
    both = Polygon(finding.where_px).intersection(wrong.region_px).area
    assert both > 0.8 * max(wrong.region_px.area, Polygon(finding.where_px).area)


@pytest.mark.parametrize("shift_px", SHIFTS_PX)
def test_a_shifted_edge(planted: dict[str, WrongDrawing], again: dict[str, Solution], shift_px: float) -> None:
    wrong = planted[f"edge shifted by {shift_px:.0f} px"]
    finding = next(one for one in review(again[wrong.kind]) if one.kind == "edge")
    assert finding.key_frame == wrong.key_frame
    assert finding.element_id in wrong.elements
    # Drawn that far from where it is expected, and the side of the polygon runs along what is drawn.
    assert finding.expected_px is not None
    apart_px = np.linalg.norm(finding.where_px - finding.expected_px, axis=1)
    assert apart_px == pytest.approx(shift_px, abs=3.0)
    element = next(e for e in wrong.scene.key_frames[wrong.key_frame].elements if e.id == finding.element_id)
    (polygon,) = element.amodal.geoms
    ring = shapely.get_coordinates(polygon.exterior)
    assert finding.edge is not None
    side = shapely.LineString(ring[finding.edge : finding.edge + 2])
    assert shapely.distance(side, shapely.points(finding.where_px)).max() < 3.0
    assert f"{apart_px.mean():.0f} px from where the planes meet" in finding.message


@pytest.mark.parametrize(("max_sigma_px", "named"), [(5.0, True), (0.01, False)])
def test_an_edge_of_what_one_drawing_shows_is_suspected_where_its_line_is_well_known(
    planted: dict[str, WrongDrawing], again: dict[str, Solution], max_sigma_px: float, named: bool
) -> None:
    kind = f"edge shifted by {SHIFTS_PX[0]:.0f} px"
    wrong, solution = planted[kind], again[kind]
    counts = {member: len(one.members) for one in solution.instances for member in one.members}
    elements = solution.scene.key_frames[wrong.key_frame].elements
    assert 1 in {counts[wrong.key_frame, e] for e, element in enumerate(elements) if element.id in wrong.elements}
    found = review(solution, ReviewConfig(max_alone_sigma_px=max_sigma_px))
    assert any(one.kind == "edge" and one.element_id in wrong.elements for one in found) == named


def test_a_deliberate_blank_is_neither_gap_nor_missing(
    planted: dict[str, WrongDrawing], again: dict[str, Solution]
) -> None:
    wrong = planted["element left out"]
    drawn = again[wrong.kind]
    key_frames = list(drawn.scene.key_frames)
    key_frames[wrong.key_frame] = replace(key_frames[wrong.key_frame], blank=wrong.region_px)
    blank = replace(drawn, scene=replace(drawn.scene, key_frames=tuple(key_frames)))
    assert review(drawn) != ()
    assert review(blank) == ()


# --- gaps and overlaps


def key_frame_of(*drawn: tuple[str, MultiPolygon], blank: MultiPolygon = rooms.NOTHING) -> Scene:
    """One key frame of 100x80 px."""
    labels: list[Any] = [label for label, _ in drawn]
    scene = rooms.make_scene([rooms.facing_camera()], [list(zip(labels, (region for _, region in drawn), strict=True))])
    return replace(scene, key_frames=(replace(scene.key_frames[0], blank=blank),))


LEFT, RIGHT = rooms.pixels(0, 0, 50, 80), rooms.pixels(50, 0, 100, 80)


def test_what_covers_the_image_has_neither_gap_nor_overlap() -> None:
    assert tiling_findings(key_frame_of(("wall", LEFT), ("floor", RIGHT), ("door", rooms.pixels(10, 10, 40, 60)))) == ()


def test_a_gap_is_named_by_what_it_lies_between() -> None:
    (gap,) = tiling_findings(key_frame_of(("wall", LEFT), ("floor", rooms.pixels(60, 0, 100, 80))))
    assert (gap.kind, gap.element_id) == ("gap", "e0")
    assert gap.severity == pytest.approx(0.1, abs=0.001)
    assert (
        gap.line
        == "0.png: gap of 9.9% of the image beside wall e0 and floor e1: draw what is there, or mark it as blank"
    )
    assert Polygon(gap.where_px).symmetric_difference(rooms.pixels(50, 0, 60, 80)).area < 10


@pytest.mark.parametrize(("width", "count"), [(5.0, 0), (7.0, 1)])
def test_a_gap_counts_from_a_width_on(width: float, count: int) -> None:
    """Two hands' lines differ."""
    scene = key_frame_of(("wall", LEFT), ("floor", rooms.pixels(50 + width, 0, 100, 80)))
    assert len(tiling_findings(scene, replace(ReviewConfig(), min_area_px2=50.0))) == count


def test_a_blank_gap_is_none() -> None:
    drawn = ("wall", LEFT), ("floor", rooms.pixels(60, 0, 100, 80))
    assert tiling_findings(key_frame_of(*drawn, blank=rooms.pixels(50, 0, 60, 80))) == ()


def test_overlaps() -> None:
    (overlap,) = tiling_findings(key_frame_of(("wall", rooms.pixels(0, 0, 60, 80)), ("floor", RIGHT)))
    assert (overlap.kind, overlap.element_id) == ("overlap", "e1")
    assert (
        overlap.message == "wall e0 and floor e1 overlap by 20% of the smaller: one label wrong, or one drawn too large"
    )
    (twice,) = tiling_findings(key_frame_of(("wall", LEFT), ("floor", RIGHT), ("window", RIGHT)))
    assert twice.message == "floor e1 and window e2 are almost the same polygon: delete one"


def test_side_along_counts_through_all_outer_rings() -> None:
    two = MultiPolygon([shapely.box(0, 0, 10, 10), Polygon([(20, 0), (30, 0), (30, 10), (20, 10)])])
    element = Element("e", "wall", two, rooms.NOTHING)
    assert side_along(element, np.array([[21.0, 10.5], [29.0, 10.5]])) == 6
    assert side_along(element, np.array([[30.5, 1.0], [30.5, 9.0]])) == 5


def test_the_worst_first() -> None:
    def finding(kind: Any, severity: float, key_frame: int) -> Finding:
        return Finding(key_frame, "a", None, None, kind, "", severity, np.zeros((2, 2)))

    given = [finding("gap", 0.9, 0), finding("edge", 4.0, 1), finding("edge", 9.0, 2), finding("label", 0.7, 3)]
    assert [one.key_frame for one in worst_first(given)] == [3, 2, 1, 0]
    assert set(KINDS) == {
        "gap", "overlap", "edge", "label", "missing", "occlusion edge missing", "shape", "another place"
    }  # fmt: skip


# --- files and commands

Edit = Callable[[Path, Callable[[Any], object]], None]


@pytest.fixture
def spoiled(room: Path, tmp_path: Path, edit_json: Edit) -> Path:
    """The room's folder, in which one element is not drawn in one frame."""
    folder = Path(shutil.copytree(room, tmp_path / "scene"))
    edit_json(folder / "annotations.json", lambda data: data["frames"][1]["elements"].pop(0))
    return folder


def test_review_of_a_folder(spoiled: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["review", str(spoiled)]) == 3
    first, *_, last = capsys.readouterr().out.splitlines()
    name = load_scene(spoiled).frame_of(1).name
    assert first.startswith(f"missing: {name}: the ")
    assert last.endswith(" in 3 drawings")
    assert main(["review", str(spoiled), "--json"]) == 3
    row = json.loads(capsys.readouterr().out)["findings"][0]
    assert (row["kind"], row["frame_name"], row["element_id"]) == ("missing", name, None)
    assert not (spoiled / "gtlayout").exists()


def test_check_says_gaps_before_a_solve(spoiled: Path) -> None:
    scene = load_scene(spoiled)
    assert any(line.startswith(f"{scene.frame_of(1).name}: gap of ") for line in gaps(scene))


def test_a_solve_prints_the_worst_findings(capsys: pytest.CaptureFixture[str]) -> None:
    findings = [Finding(0, "a.png", None, None, "gap", f"number {i}", 0.1, np.zeros((2, 2))) for i in range(7)]
    print_findings(stdout(), findings, verbose=False)
    printed = capsys.readouterr().out.splitlines()
    assert printed == [*(f"gap: a.png: number {i}" for i in range(5)), "… and 2 more findings (see them with -v)"]
    print_findings(stdout(), findings, verbose=True)
    assert capsys.readouterr().out.splitlines() == [f"gap: a.png: number {i}" for i in range(7)]


def test_results_hold_the_findings_and_the_report_shows_them(
    solution: Solution, again: dict[str, Solution], tmp_path: Path
) -> None:
    findings = review(again["edge shifted by 30 px"])
    assert review_text(review(again["edge shifted by 30 px"])) == review_text(findings)
    save(solution, tmp_path, findings)
    read = read_review(tmp_path, solution.scene)
    assert read is not None
    assert review_text(read) == review_text(findings)
    page = tmp_path / "page.html"
    assert main(["report", str(solution.scene.root), "--layout", str(tmp_path), "--out", str(page)]) == 0
    html = page.read_text()
    assert "Drawings to look at" in html
    assert findings[0].message in html
    assert len(re.findall(r'<polyline class="wrong" points="[^"]*"><title>', html)) == len(findings)
    save(solution, tmp_path)
    assert not (tmp_path / REVIEW_FILE).exists()


def test_a_file_of_other_drawings_or_a_damaged_one(solution: Solution, tmp_path: Path) -> None:
    assert read_review(tmp_path, solution.scene) is None
    one = Finding(0, "other.png", None, None, "gap", "", 0.1, np.zeros((3, 2)))
    (tmp_path / REVIEW_FILE).write_text(review_text([one]))
    with pytest.raises(GtlayoutError, match="of other annotations"):
        read_review(tmp_path, solution.scene)
    for damage in ({"kind": "nonsense"}, {"where_px": [[1]]}, {"severity": None}):
        data = json.loads(review_text([one]))
        data["findings"][0] |= damage
        (tmp_path / REVIEW_FILE).write_text(json.dumps(data))
        with pytest.raises(GtlayoutError, match="is damaged"):
            read_review(tmp_path, solution.scene)
    (tmp_path / REVIEW_FILE).write_text('{"format": "x"}')
    with pytest.raises(GtlayoutError, match="is not a review"):
        read_review(tmp_path, solution.scene)


# --- the evaluation


def test_shifts_are_as_large_as_said(solution: Solution, planted: dict[str, WrongDrawing]) -> None:
    for shift_px in SHIFTS_PX:
        wrong = planted[f"edge shifted by {shift_px:.0f} px"]
        before, after = (
            {element.id: element.amodal for element in scene.key_frames[wrong.key_frame].elements}
            for scene in (solution.scene, wrong.scene)
        )
        giving, taking = wrong.elements
        moved = opened(before[giving].difference(after[giving]), 0.5)
        taken = opened(after[taking].difference(before[taking]), 0.5)
        assert moved.symmetric_difference(taken).area < 0.1 * moved.area
        sides = shapely.get_coordinates(shapely.minimum_rotated_rectangle(moved))[:3]
        assert np.linalg.norm(np.diff(sides, axis=0), axis=1).min() == pytest.approx(shift_px, abs=3.0)


def test_an_error_is_named_only_in_its_frame_and_by_what_is_new(planted: dict[str, WrongDrawing]) -> None:
    wrong = planted["labels swapped"]
    right = Finding(wrong.key_frame, "a", wrong.elements[0], None, "label", "", 1.0, np.zeros((2, 2)))
    assert is_named(wrong, [right])
    assert not is_named(wrong, [replace(right, key_frame=wrong.key_frame + 1)])
    assert not is_named(wrong, [replace(right, element_id="another")])
    assert new_findings([right], [replace(right, message="before")]) == ()


def test_pooled_counts() -> None:
    def row(planted: float, named: float) -> list[Metric]:
        return [Metric("planted", planted, "", None), Metric("named", named, "", None)]

    table = pooled([{"swap": row(3, 3)}, {"swap": row(1, 0), "gap": row(2, 1)}])
    assert {metric.key: metric.value for metric in table["swap"]} == {"planted": 4, "named": 3, "named, share": 0.75}
    assert {metric.key: metric.value for metric in table["gap"]}["named, share"] == 0.5


def test_solved_again_without_a_change_is_the_same_room(solution: Solution) -> None:
    again = solve_again(solution, solution.scene)
    assert [one.members for one in again.instances] == [one.members for one in solution.instances]
    for before, after in zip(solution.planes, again.planes, strict=True):
        assert after.normal == pytest.approx(before.normal, abs=1e-3)


def test_key_frames_are_not_blank_by_default() -> None:
    assert KeyFrame(0, ()).blank.is_empty
