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
from playwright.sync_api import Page

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
from gtlayout.report.room_view import upright
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
    write_results(out, solution.scene, solution.layout, solution.quality, Config(), timings_s=solution.timings_s)
    (out / "layout.json").write_text((out / "layout.json").read_text().replace('"wall_0"', json.dumps(NAME)))
    quality = json.loads((out / "quality.json").read_text())
    (out / "quality.json").write_text(json.dumps(quality | {"warnings": [WARNING]}))
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
    out = tmp_path / "new" / "page.html"
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
