"""The report: what it says, that nothing in it comes from or goes to a network, and that it works in a browser."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, expect
from shapely import Point

from gtlayout.cli.app import main
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.instances import Mesh
from gtlayout.io.files import write_json_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.layout import Layout
from gtlayout.method import solve
from gtlayout.quality.headline import Headline, Word
from gtlayout.report import page as html_of
from gtlayout.report import report_data
from gtlayout.report.files import read_records
from gtlayout.report.frames import shown_width
from gtlayout.report.next_steps import Step
from gtlayout.report.room_view import room_view, upright
from gtlayout.results.evidence import MAX_TRACKS, evidence_of
from gtlayout.results.layout_files import write_results
from gtlayout.solution import Solution

NAME = "<script>alert(1)</script>"
ELEMENT_ID = '"></svg><img src=x onerror=alert(2)>'
WARNING = "</script><script>alert(3)</script>"


@pytest.fixture(scope="module")
def solution(room: Path, tmp_path_factory: pytest.TempPathFactory) -> Solution:
    """Of a scene whose elements' ids are meant to run in a browser."""
    scene = Path(shutil.copytree(room, tmp_path_factory.mktemp("hostile") / "scene"))
    annotations = json.loads((scene / "annotations.json").read_text())
    for key_frame in annotations["frames"]:
        key_frame["elements"][0]["id"] = ELEMENT_ID
    write_json_atomic(scene / "annotations.json", annotations)
    return solve(load_scene(scene), Config())


@pytest.fixture(scope="module")
def hostile(solution: Solution) -> Path:
    """The folder of that scene, with results whose names and warnings are meant to run, too, and the report."""
    scene = solution.scene.root
    out = scene / "gtlayout"
    write_results(
        out,
        solution.scene,
        solution.layout,
        solution.quality,
        Config(),
        timings_s=solution.timings_s,
        evidence=evidence_of(solution),
    )
    (out / "layout.json").write_text((out / "layout.json").read_text().replace('"wall_0"', json.dumps(NAME)))
    quality = json.loads((out / "quality.json").read_text())
    (out / "quality.json").write_text(json.dumps(quality | {"warnings": [WARNING]}))
    evidence = out / "evidence.json"
    evidence.write_text(evidence.read_text().replace('"wall_0"', json.dumps(NAME)))
    assert main(["report", str(scene)]) == 0
    return scene


def said(solution: Solution, layout: Layout | None = None) -> dict[str, object]:
    """The data of a page without photos."""
    photos = [None] * len(solution.scene.key_frames)
    layout = layout or solution.layout
    return report_data(solution.scene, layout, solution.quality, photos, timings_s={}, config={}, versions={})


def test_data_says_what_the_layout_is(solution: Solution) -> None:
    data = report_data(
        solution.scene,
        solution.layout,
        solution.quality,
        [None] * len(solution.scene.key_frames),
        timings_s={"tracking": 3.0, "estimation": 1.0},
        config={"seed": 0, "tracking": {"max_points": 5, "sides": [1, 2]}},
        versions={"numpy": "2"},
    )
    json.dumps(data, allow_nan=False)
    assert data["headline"] == asdict(solution.quality.headline)
    assert data["accepted"] == solution.quality.accepted
    for row, instance, judged in zip(
        data["instances"], solution.layout.instances, solution.quality.instances, strict=True
    ):
        assert (row["name"], row["verdict"], row["iou"]) == (instance.name, judged.verdict, judged.iou)
        assert (row["sigma_depth"], row["depth"]) == (judged.sigma_depth, judged.depth)
    assert [frame["iou"] for frame in data["frames"]] == list(solution.quality.frames)
    assert sum(len(frame["elements"]) for frame in data["frames"]) == len(solution.quality.elements)
    assert [one["share"] for one in data["timings"]] == [0.75, 0.25]
    assert data["config"] == [("seed", "0"), ("tracking.max_points", "5"), ("tracking.sides", "[1, 2]")]
    assert data["floor_plan"].startswith("data:image/svg+xml;base64,")


def test_room_is_shown_upright_with_its_sigma(solution: Solution) -> None:
    turn = upright(solution.scene, solution.layout)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)
    by_name = dict(zip([i.name for i in solution.layout.instances], solution.layout.planes, strict=True))
    np.testing.assert_allclose(turn @ by_name["floor_0"].normal, [0, 0, 1], atol=1e-12)
    room = said(solution)["room"]
    assert isinstance(room, dict)
    for surface in room["instances"]:
        points = np.array(surface["vertices"]).T
        plane = by_name[surface["name"]]
        np.testing.assert_allclose(surface["sigma"], plane.sigma_offset(points @ turn), rtol=1e-2)
        # Vertices are shared with neighbours, so they lie near their plane only.
        assert np.abs(points @ surface["normal"] + surface["d"]).max() < 0.02
        assert (points > room["low"]).all()
        assert (points < room["high"]).all()


def test_page_without_metric_scale_or_mesh_or_photos_says_so(solution: Solution) -> None:
    html = html_of(said(solution))
    assert html.count("image cannot be read") == len(solution.scene.key_frames)
    assert "in metres (m)" in html
    bare = html_of(said(solution, replace(solution.layout, metric=False, triangles=Mesh.empty())))
    assert "not metres" in bare
    assert 'id="room-view"' not in bare
    assert len(bare) < 1_000_000, "plotly is left out"


@pytest.mark.parametrize(("word", "colour"), [("trust", "good"), ("check", "warn"), ("redo", "bad")])
def test_page_begins_with_the_headline(solution: Solution, word: Word, colour: str) -> None:
    quality = replace(solution.quality, headline=Headline(word, ("the <first> reason", "another")))
    photos = [None] * len(solution.scene.key_frames)
    data = report_data(solution.scene, solution.layout, quality, photos, timings_s={}, config={}, versions={})
    html = html_of(data, plotly_src="plotly.min.js")
    first = html.index(f'<h2><span class="{colour}">{word.capitalize()}</span>: the &lt;first&gt; reason</h2>')
    assert f'<section id="verdict" class="verdict {word}">' in html
    assert first < html.index("<li>another</li>") < html.index("accepted</b>") < html.index("predicted <b")
    assert html.index("predicted <b") < html.index('<section id="instances">')


def test_many_key_frames_are_shown_smaller() -> None:
    assert [shown_width(*case) for case in ((640, 8), (1920, 8), (1920, 40), (1920, 160))] == [640, 960, 960, 480]


def test_same_results_same_bytes(hostile: Path, tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    assert main(["report", str(hostile), "--layout", str(hostile / "gtlayout"), "--out", str(out)]) == 0
    assert out.read_bytes() == (hostile / "gtlayout/report.html").read_bytes()


def test_page_holds_all_it_needs_and_names_are_text(hostile: Path) -> None:
    html = (hostile / "gtlayout/report.html").read_text()
    for text in (NAME, ELEMENT_ID, WARNING):
        assert text not in html
    own = re.sub(r'<script type="text/plain".*?</script>', "", html, flags=re.DOTALL)
    assert len(own) < len(html) - 4_000_000, "plotly is not ours to look into"
    assert not re.findall(r"""(?:src|href)\s*=\s*["'](?!data:|#)|@import|url\(""", own)


@pytest.mark.parametrize(
    ("file", "content"),
    [("timings.json", {"seconds": [1]}), ("timings.json", {"seconds": {"mesh": "x"}}), ("config.json", {"config": 3})],
)
def test_damaged_record_is_named(tmp_path: Path, file: str, content: object) -> None:
    (tmp_path / file).write_text(json.dumps(content))
    with pytest.raises(GtlayoutError, match=r"damaged.*solve the scene again"):
        read_records(tmp_path)


def test_report_needs_a_layout(room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(room), "--layout", str(tmp_path)]) == 1
    assert "layout.json" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_evidence_of_a_solve_is_kept_and_small(solution: Solution, hostile: Path) -> None:
    seen = evidence_of(solution)
    assert {one.instance for one in seen.tracks} <= set(range(len(solution.instances)))
    for one in seen.tracks:
        (element,) = (e for k, e in solution.instances[one.instance].members if k == one.key_frame)
        drawn = solution.scene.key_frames[one.key_frame].elements[element].amodal.buffer(3)
        assert 0 < len(one.weight) <= MAX_TRACKS
        assert ((one.weight >= 0) & (one.weight <= 1)).all()
        assert np.mean([drawn.contains(Point(*point)) for point in one.points_px]) > 0.9
    assert seen.edges
    for edge in seen.edges:
        ends_px = np.linalg.norm(edge.drawn_px - edge.expected_px, axis=1)
        assert edge.misfit_px <= ends_px.max() + 2
    assert sum(edge.used for edge in seen.edges) > len(seen.edges) / 2
    assert all({"tracks", "contact edges"} & {one.kind for one in trail.alone} for trail in seen.trails)
    middles = [plane.normal @ trail.middle + plane.d for plane, trail in zip(solution.planes, seen.trails, strict=True)]
    np.testing.assert_allclose(middles, 0, atol=1e-6)
    assert (hostile / "gtlayout/evidence.json").stat().st_size < 100_000


def test_results_without_evidence_have_a_report_without_panels(
    hostile: Path, solution: Solution, tmp_path: Path
) -> None:
    """As those of earlier versions; and none is left of another solve."""
    results = Path(shutil.copytree(hostile / "gtlayout", tmp_path / "results"))
    write_results(results, solution.scene, solution.layout, solution.quality, Config())
    assert not (results / "evidence.json").exists()
    out = tmp_path / "page.html"
    assert main(["report", str(hostile), "--layout", str(results), "--out", str(out)]) == 0
    assert 'id="planes"' not in out.read_text()
    assert 'id="planes"' in (hostile / "gtlayout/report.html").read_text()


def test_the_view_holds_what_is_reliable(solution: Solution) -> None:
    count = len(solution.instances)
    every, only_floor, none = (
        room_view(solution.scene, solution.layout, 0.1, reliable)
        for reliable in ([True] * count, [one.label == "floor" for one in solution.instances], [False] * count)
    )
    high = max(x for one in every["instances"] if one["name"] == "floor_0" for x in one["vertices"][2])
    path = max(every["path"][2])
    assert only_floor["high"][2] == pytest.approx(max(high, path), abs=0.1)
    assert every["high"][2] > only_floor["high"][2] + 0.3
    assert (none["low"], none["high"]) == (every["low"], every["high"]), "else there is nothing to see"
    assert [one["reliable"] for one in only_floor["instances"]].count(True) == 1


def test_every_photo_is_in_the_page_once(hostile: Path) -> None:
    html = (hostile / "gtlayout/report.html").read_text()
    frames = html.count('<figure id="frame-')
    assert html.count("data:image/jpeg") == frames
    assert html.count('<use href="#photo-') > 2 * frames


def pages_on_paper(page: Page, address: str) -> int:
    page.goto(address)
    pdf = page.pdf(prefer_css_page_size=True, print_background=True)
    return len(re.findall(rb"/Type\s*/Page\b", pdf))


def test_report_prints_on_two_pages(hostile: Path, page: Page) -> None:
    assert pages_on_paper(page, (hostile / "gtlayout/report.html").as_uri()) == 2


@pytest.mark.parametrize("plan", [True, False])
def test_a_large_scene_prints_on_two_pages_too(solution: Solution, page: Page, tmp_path: Path, plan: bool) -> None:
    """Forty instances, ten reasons of three lines each, and as many of the headline."""
    data = report_data(
        solution.scene,
        solution.layout,
        solution.quality,
        [None] * len(solution.scene.key_frames),
        timings_s={},
        config={},
        versions={},
        evidence=evidence_of(solution),
    )
    words = "a reason that needs many words " * 12
    data["instances"] = (data["instances"] * 40)[:40]
    data["dimensions"] = [one | {"of": "a – b"} for one in (data["dimensions"] * 20)[:20]]
    data["reasons"] = [{"reason": words, "names": ["wall_0"] * 30, "causes": [words]}] * 10
    data["headline"] = {"word": "redo", "reasons": [words] * 10}
    step = asdict(Step(words, words * 3, 0, "0 0 40 30", "M0 0L1 1Z"))
    data |= {"next_steps": [step] * 3, "title": "a name " * 40, "room": None}
    # Two surfaces that are not flat are named on paper, too; those that are even are not.
    uneven = {"deviation_mm": -43.0, "sigma_mm": 10.0, "distance_m": 4.2, "limit_mm": 10.0, "line": 6}
    data["flatness"] = [
        uneven | {"of": f"surface_{number}", "status": "out" if number in (7, 9, 11) else "within"}
        for number in range(20)
    ]
    data |= {} if plan else {"floor_plan": None}
    (tmp_path / "large.html").write_text(html_of(data))
    assert pages_on_paper(page, (tmp_path / "large.html").as_uri()) == 2
    page.emulate_media(media="print")
    # What does not fit is said: headline, reasons, instances, dimensions, flatness.
    for left_out in (6, 6, 26, 13, 1):
        assert page.get_by_text(f"… and {left_out} more, which are in the page itself.").first.is_visible()
    shown = [number for number in range(20) if page.get_by_text(f"surface_{number}", exact=True).is_visible()]
    assert shown == [7, 9]


def pixels(page: Page) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """The 3D view as it is shown, BGR."""
    image = cv2.imdecode(np.frombuffer(page.locator("#room-view").screenshot(), dtype=np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image.astype(np.uint8, copy=False)


def colored(image: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> float:
    """Share of the pixels that are not grey."""
    return float((np.ptp(image.astype(int), axis=-1) > 30).mean())


def test_report_works_in_a_browser(hostile: Path, page: Page, problems: list[str]) -> None:
    page.goto((hostile / "gtlayout/report.html").as_uri())

    # Names stay text.
    assert page.locator("#instances td", has_text=NAME).count() >= 1
    assert page.locator("#instance-legend span", has_text=NAME).count() == 1
    assert page.locator("svg.annotation text", has_text=NAME).count() >= 1
    page.locator("#warnings summary").click()
    assert page.locator("#warnings li", has_text=WARNING).is_visible()
    assert page.locator("img[src=x]").count() == 0

    # Layers of the frames.
    for layer in ("photo", "annotation", "rendering", "differences"):
        shown = page.locator(f"#frames .{layer}").first
        assert shown.is_visible()
        page.locator(f"#show-{layer}").click()
        assert not shown.is_visible()

    # The worst frame comes first.
    ious = [
        float(text.rsplit("IoU ", 1)[1].split()[0]) for text in page.locator("#frames figcaption").all_inner_texts()
    ]
    assert ious == sorted(ious)

    # A link to a plane unfolds its evidence, and so does the keyboard.
    panel = page.locator("#plane-1")
    assert panel.get_attribute("open") is None
    page.locator("#instances tbody a").nth(1).click()
    expect(panel).to_have_attribute("open", "")
    assert panel.locator("td", has_text="all together").is_visible()
    assert panel.locator("svg.window path.dots").count() >= 1
    panel.locator("summary").press("Enter")
    assert panel.get_attribute("open") is None
    for part in ("#next svg.window", "#planes svg.window", "#frames svg.photo"):
        assert page.locator(f"{part}:not([aria-label])").count() == 0

    # The table sorts, numbers as numbers, both ways.
    column = "#instances tbody td:nth-child(5)"
    for descending in (False, True):
        page.locator("#instances th button", has_text="tracks").click()
        tracks = [int(text) for text in page.locator(column).all_inner_texts()]
        assert tracks == sorted(tracks, reverse=descending)
    assert page.locator("#instances th[aria-sort]").get_attribute("aria-sort") == "descending"

    # The room is drawn, in other colours by σ, and in the first ones again.
    page.wait_for_selector("#room-view[data-drawn]", timeout=60_000)
    by_instance = pixels(page)
    assert colored(by_instance) > 0.05
    page.locator("[data-mode=sigma]").click()
    assert page.locator("#sigma-legend").is_visible()
    by_sigma = pixels(page)
    assert colored(by_sigma) > 0.05
    assert np.abs(by_sigma.astype(int) - by_instance).max(axis=-1).mean() > 3
    page.locator("[data-mode=instance]").click()
    assert np.abs(pixels(page).astype(int) - by_instance).mean() < 1
    assert problems == []


def test_report_fits_a_phone(hostile: Path, page: Page, problems: list[str]) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto((hostile / "gtlayout/report.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert page.evaluate("document.querySelector('#instances .scroll').scrollWidth") > 390, "its table scrolls"
    assert problems == []
