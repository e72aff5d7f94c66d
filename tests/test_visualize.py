"""What is logged to rerun, read back from the file, and how a browser draws it."""

from __future__ import annotations

import time
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page
from rerun.chunk import Chunk, RrdReader
from web_viewer import web_viewer

from gtlayout.closing.close import close
from gtlayout.colors import instance_colors, sigma_colors
from gtlayout.config import Config
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve
from gtlayout.observer import Observer
from gtlayout.scene import FloatArray
from gtlayout.solution import Solution
from gtlayout.viewer.blueprint import blueprint
from gtlayout.viewer.session import rerun_observer

ELSEWHERE = (
    "request: https://",
    "console: Failed to load resource: net::ERR_FAILED",
    "console: TypeError: Failed to fetch",
)
"""What Chromium says of requests that leave this machine, and of those that failed for it."""

Log = dict[str, list[Chunk]]


@pytest.fixture(scope="module")
def logged(room: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Solution, Path, Log]:
    path = tmp_path_factory.mktemp("log") / "log.rrd"
    with rerun_observer("save", path, Observer()) as observer:
        solution = close(solve(load_scene(room), Config(), observer))
        observer.inferred(solution.layout)
        assert not path.exists(), "a log appears when it is whole"
    chunks: Log = defaultdict(list)
    for chunk in RrdReader(path).stream():
        chunks[chunk.entity_path].append(chunk)
    return solution, path, chunks


def _times(chunks: list[Chunk], timeline: str) -> list[int]:
    batches = [chunk.to_record_batch() for chunk in chunks if timeline in chunk.timeline_names]
    return sorted(int(at) for batch in batches for at in batch.column(timeline).to_pylist())


def test_every_frame_has_camera_image_and_tracks(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    every = list(range(len(solution.scene.frames)))
    for entity in ("", "/image", "/image/rgb", "/image/points", "/image/tails"):
        assert _times(log[f"/world/camera{entity}"], "frame") == every, entity


def test_every_key_frame_has_annotation_edges_and_rendering(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    key_frames = [key_frame.frame for key_frame in solution.scene.key_frames]
    for name in ("rgb", "amodal", "visible", "occlusion_edges", "contact_edges", "annotated", "rendered", "differs"):
        assert _times(log[f"/key_frame/{name}"], "frame") == key_frames, name
    assert _times(log["/quality/iou"], "frame") == key_frames


def test_what_closes_the_room_is_an_entity_of_its_own(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    inferred = {
        f"/world/inferred/inferred_{instance.name}"
        for instance, extent in zip(solution.instances, solution.layout.inferred, strict=True)
        if not extent.region.is_empty
    }
    assert inferred
    assert {entity for entity in log if entity.startswith("/world/inferred/")} == inferred


def test_every_instance_has_its_surfaces(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    for index, instance in enumerate(solution.layout.instances):
        for group in ("landmarks", "extents/before", "extents/after"):
            assert f"/world/{group}/{instance.name}" in log
        if (solution.layout.triangles.face_instance == index).any():
            assert f"/world/mesh/{instance.name}" in log
            (batch,) = (chunk.to_record_batch() for chunk in log[f"/world/uncertainty/{instance.name}"])
            colors, vertices = (
                batch.column(f"Mesh3D:{name}").to_pylist()[0] for name in ("vertex_colors", "vertex_positions")
            )
            assert len(colors) == len(vertices)
            # The ends of turbo would be σ 0 and σ 10 cm: a small room is known better than that, but not exactly.
            rgb = np.array(colors, dtype=np.uint32)[:, None] >> np.array([24, 16, 8]) & 255
            expected = sigma_colors(solution.layout.planes[index].sigma_offset(np.array(vertices)) / 0.1)
            np.testing.assert_allclose(rgb, expected, atol=2)


def test_scale_of_sigma_runs_from_blue_to_red() -> None:
    colors = sigma_colors(np.array([0.0, 0.5, 1.0, 7.0, np.nan])).astype(int)
    np.testing.assert_array_equal(colors[2:], np.broadcast_to(colors[2], (3, 3)))
    blue, green, red = colors[:3]
    assert blue.argmax() == 2
    assert green.argmax() == 1
    assert red.argmax() == 0


def test_sheets_lie_one_sigma_to_either_side(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    drawn = np.unique(solution.layout.triangles.face_instance)
    assert len(drawn)
    for index in drawn:
        name, plane = solution.layout.instances[index].name, solution.layout.planes[index]
        middle = _vertices(log[f"/world/uncertainty/{name}"])
        sigma = plane.sigma_offset(middle)
        assert sigma.max() > 1.01 * sigma.min() > 0, "σ varies over a surface"
        for side, sign in (("towards", 1.0), ("away", -1.0)):
            chunks = log[f"/world/sheets/{side}/{name}"]
            height = (_vertices(chunks) - middle) @ plane.normal
            np.testing.assert_allclose(height, sign * sigma, atol=1e-5)
            (factor,) = chunks[0].to_record_batch().column("Mesh3D:albedo_factor").to_pylist()[0]
            assert 0 < factor & 255 < 255, "translucent"


def _vertices(chunks: list[Chunk]) -> FloatArray:
    """(V, 3) of the only mesh."""
    (batch,) = (chunk.to_record_batch() for chunk in chunks)
    return np.array(batch.column("Mesh3D:vertex_positions").to_pylist()[0])


def test_dimensions_are_drawn_with_their_sigma(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    assert "/world/dimensions" in log
    (batch,) = (chunk.to_record_batch() for chunk in log["/world/dimensions/labels"])
    (labels,) = batch.column("Points3D:labels").to_pylist()
    assert labels == [f"{one.length:.3f} ± {one.sigma:.3f} m" for one in solution.layout.dimensions]
    assert any(one.kind == "height" for one in solution.layout.dimensions)
    for at, one in zip(batch.column("Points3D:positions").to_pylist()[0], solution.layout.dimensions, strict=True):
        assert np.linalg.norm(at - one.ends_world, axis=1).sum() == pytest.approx(one.length, rel=1e-5)


def test_iou_of_each_element_is_a_series(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    scene, quality = solution.scene, solution.quality
    assert _scalars(log["/quality/iou"], "frame") == pytest.approx(
        {scene.key_frames[number].frame: iou for number, iou in enumerate(quality.frames)}
    )
    for index, instance in enumerate(solution.layout.instances):
        own = {scene.key_frames[e.key_frame].frame: e.iou for e in quality.elements if e.instance == index}
        assert _scalars(log[f"/quality/instances/{instance.name}"], "frame") == pytest.approx(own)


def _scalars(chunks: list[Chunk], timeline: str) -> dict[int, float]:
    """Value by time."""
    found: dict[int, float] = {}
    for batch in (chunk.to_record_batch() for chunk in chunks if timeline in chunk.timeline_names):
        values = np.ravel(batch.column("Scalars:scalars").to_pylist()).tolist()
        found.update(zip((int(at) for at in batch.column(timeline).to_pylist()), values, strict=True))
    return found


def test_cost_and_planes_per_iteration(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    iterations = solution.estimate.iterations
    assert len(iterations) > 1
    assert _scalars(log["/solver/cost"], "iteration") == pytest.approx(dict(enumerate(it.cost for it in iterations)))
    assert _times(log["/solver/cost"], "frame") == [], "iterations are not frames"
    assert iterations[1].cost < iterations[0].cost, "the first is the start"
    for index, instance in enumerate(solution.layout.instances):
        chunks = log[f"/world/planes/{instance.name}"]
        assert _times(chunks, "frame") == [0], "who looks at frames sees the last"
        squares: dict[int, list[list[list[float]]]] = {}
        for batch in (chunk.to_record_batch() for chunk in chunks if "iteration" in chunk.timeline_names):
            strips = batch.column("LineStrips3D:strips").to_pylist()
            squares.update(zip((int(at) for at in batch.column("iteration").to_pylist()), strips, strict=True))
        assert sorted(squares) == list(range(len(iterations)))
        for number, (square,) in squares.items():
            plane = iterations[number].planes[index]
            np.testing.assert_allclose(np.array(square) @ plane[:3] + plane[3], 0.0, atol=1e-5)


def test_each_stage_has_a_tab_and_the_room_comes_first(room: Path) -> None:
    tabs = blueprint(load_scene(room)).root_container
    names = [tab.name for tab in tabs.contents]
    assert names == ["Tracks", "Instances", "Edges", "Planes", "Extents", "Room", "Uncertainty", "Quality"]
    assert isinstance(tabs.active_tab, int)
    assert names[tabs.active_tab] == "Room"


def test_log_is_small_and_opens_with_a_blueprint(logged: tuple[Solution, Path, Log]) -> None:
    _, path, log = logged
    assert path.stat().st_size < 2e6
    assert "/summary" in log
    assert len(RrdReader(path).blueprints()) >= 1


def test_logging_changes_nothing(room_solution: Solution, logged: tuple[Solution, Path, Log]) -> None:
    for one, other in zip(room_solution.layout.planes, logged[0].layout.planes, strict=True):
        np.testing.assert_array_equal(one.normal, other.normal)
        np.testing.assert_array_equal(one.covariance, other.covariance)


def test_off_is_the_progress_observer_itself(tmp_path: Path) -> None:
    progress = Observer()
    with rerun_observer("off", tmp_path / "log.rrd", progress) as observer:
        assert observer is progress
    assert list(tmp_path.iterdir()) == []


def test_failed_run_leaves_no_log(room: Path, tmp_path: Path) -> None:
    log = tmp_path / "out" / "log.rrd"
    with pytest.raises(ZeroDivisionError), rerun_observer("save", log, Observer()) as observer:
        observer.scene(load_scene(room))
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_browser_draws_the_room(
    logged: tuple[Solution, Path, Log], free_ports: int, page: Page, problems: list[str]
) -> None:
    """Rerun's page asks the network for a font and for news and tells it of its use: it has to do without."""
    _, path, _ = logged
    with web_viewer(path, free_ports) as address:
        page.set_viewport_size({"width": 800, "height": 600})  # less for a software rasterizer to do
        page.goto(address)
        floor = instance_colors(0).astype(int)
        give_up = time.monotonic() + 120
        drawn = 0
        while drawn < 2000 and time.monotonic() < give_up:
            page.wait_for_timeout(1000)
            shot = cv2.imdecode(np.frombuffer(page.screenshot(timeout=60_000), np.uint8), cv2.IMREAD_COLOR)
            assert shot is not None
            drawn = int((np.abs(shot[..., ::-1].astype(int) - floor).max(axis=2) < 8).sum())
        assert drawn >= 2000, f"{drawn} pixels of the first surface; {problems}"
    assert [said for said in problems if not said.startswith(ELSEWHERE)] == []
