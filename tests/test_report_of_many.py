"""What a run of many scenes keeps of each: a page that shares plotly.js with the others, and a thumbnail."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from browser import served
from playwright.sync_api import Page

from gtlayout.errors import GtlayoutError
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve
from gtlayout.report import PLOTLY_FILE, plotly_file, solved_page, thumbnail
from gtlayout.solution import Solution
from gtlayout.synth import SynthConfig, synthesize


@pytest.fixture(scope="module")
def solution(tmp_path_factory: pytest.TempPathFactory) -> Solution:
    scene = tmp_path_factory.mktemp("many") / "scene"
    synthesize(scene, SynthConfig(frames=16, key_every=5, width=240, height=180, oversample=1))
    return solve(load_scene(scene))


@pytest.fixture(scope="module")
def pages(solution: Solution, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds plotly.js and, two folders below it, a scene's page."""
    folder = tmp_path_factory.mktemp("pages") / "a run"
    plotly_file(folder)
    page = folder / "scenes/a/report.html"
    page.parent.mkdir(parents=True)
    page.write_text(solved_page(solution, f"../../{PLOTLY_FILE}"), encoding="utf-8")
    return folder


@pytest.fixture
def address(pages: Path) -> Iterator[str]:
    """Where the folder is served over HTTP."""
    with served(pages) as root:
        yield root


def test_page_is_small_and_names_plotly(pages: Path) -> None:
    html = (pages / "scenes/a/report.html").read_text(encoding="utf-8")
    assert html.count("plotly.min.js") == 2, "the script and what is said when it is absent"
    assert len(html) < 400_000


def test_plotly_is_written_once(pages: Path) -> None:
    before = (pages / PLOTLY_FILE).stat()
    plotly_file(pages)
    assert (pages / PLOTLY_FILE).stat().st_ino == before.st_ino
    content = (pages / PLOTLY_FILE).read_bytes()
    (pages / PLOTLY_FILE).write_bytes(content[:1000])
    plotly_file(pages)
    assert (pages / PLOTLY_FILE).read_bytes() == content


def test_plotly_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / PLOTLY_FILE).mkdir()
    with pytest.raises(GtlayoutError, match=PLOTLY_FILE):
        plotly_file(tmp_path)


def test_room_is_drawn_from_a_file(pages: Path, page: Page, problems: list[str]) -> None:
    page.goto((pages / "scenes/a/report.html").as_uri())
    page.wait_for_selector("#room-view[data-drawn]", timeout=60_000)
    assert page.locator("#room-view canvas").count() > 0
    assert problems == []


def test_room_is_drawn_from_a_server_and_no_other_is_asked(address: str, page: Page, problems: list[str]) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{address}/scenes/a/report.html")
    page.wait_for_selector("#room-view[data-drawn]", timeout=60_000)
    fetched = [url for url in asked if not url.startswith(("data:", "blob:", f"{address}/favicon"))]
    assert fetched == [f"{address}/scenes/a/report.html", f"{address}/plotly.min.js"]
    page.evaluate(
        """new Promise(resolve => {
        const script = document.createElement("script");
        script.onload = script.onerror = resolve;
        script.src = "https://example.org/x.js";
        document.head.append(script);
    })"""
    )
    assert any("Content Security Policy" in problem for problem in problems)
    assert not any(problem.startswith("request:") for problem in problems)


def test_page_alone_says_what_is_missing(pages: Path, tmp_path: Path, page: Page) -> None:
    shutil.copy(pages / "scenes/a/report.html", tmp_path)
    page.goto((tmp_path / "report.html").as_uri())
    page.locator("#room-view", has_text="plotly.min.js").wait_for()
    assert page.locator("#instances tbody tr").count() > 0


def decoded(jpeg: bytes) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    image = cv2.imdecode(np.frombuffer(jpeg, dtype=np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image.astype(np.uint8, copy=False)


def test_thumbnail_shows_the_worst_frame(solution: Solution) -> None:
    scene, layout, quality = solution.scene, solution.layout, solution.quality
    made = thumbnail(scene, layout, quality)
    assert made == thumbnail(scene, layout, quality)
    assert len(made) < 40_000
    shown = decoded(made).astype(int)
    assert shown.shape == (240, 320, 3)

    def off(number: int) -> float:
        photo = cv2.imread(str(scene.frame_of(number).image_path))
        assert photo is not None
        return float(np.abs(cv2.resize(photo, (320, 240)).astype(int) - shown).mean())

    assert min(range(len(scene.key_frames)), key=off) == quality.worst_frame
    other = (quality.worst_frame + 1) % len(scene.key_frames)
    assert thumbnail(scene, layout, replace(quality, worst_frame=other)) != made


def test_thumbnail_without_photo_shows_the_rendering(solution: Solution) -> None:
    scene, worst = solution.scene, solution.scene.key_frames[solution.quality.worst_frame].frame
    frames = list(scene.frames)
    frames[worst] = replace(frames[worst], image_path=Path("absent.png"))
    shown = decoded(thumbnail(replace(scene, frames=tuple(frames)), solution.layout, solution.quality))
    assert shown.shape == (240, 320, 3)
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 10, "instances in their colours"
