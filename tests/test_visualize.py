"""What is logged to rerun, read back from the file, and how a browser draws it."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import Chunk, RrdReader

from gtlayout.colors import sigma_colors
from gtlayout.config import Config
from gtlayout.io import load_scene
from gtlayout.method import Solution, solve
from gtlayout.visualize import Observer, rerun_observer

Log = dict[str, list[Chunk]]


@pytest.fixture(scope="module")
def logged(room: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Solution, Path, Log]:
    path = tmp_path_factory.mktemp("log") / "log.rrd"
    with rerun_observer("save", path, Observer()) as observer:
        solution = solve(load_scene(room), Config(), observer)
        assert not path.exists(), "a log appears when it is whole"
    chunks: Log = defaultdict(list)
    for chunk in RrdReader(path).stream():
        chunks[chunk.entity_path].append(chunk)
    return solution, path, chunks


def _times(chunks: list[Chunk], timeline: str) -> list[int]:
    batches = [chunk.to_record_batch() for chunk in chunks if timeline in chunk.timeline_names]
    return sorted(int(time) for batch in batches for time in batch.column(timeline).to_pylist())


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


def test_every_instance_has_its_surfaces(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    for index, instance in enumerate(solution.layout.instances):
        for group in ("landmarks", "extents/before", "extents/after"):
            assert f"/world/{group}/{instance.name}" in log
        if (solution.layout.mesh.face_instance == index).any():
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


def test_dimensions_are_drawn_with_their_sigma(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    (batch,) = (chunk.to_record_batch() for chunk in log["/world/dimensions"])
    (labels,) = batch.column("LineStrips3D:labels").to_pylist()
    assert labels == [f"{one.length:.3f} ± {one.sigma:.3f} m" for one in solution.layout.dimensions]
    assert any(one.kind == "height" for one in solution.layout.dimensions)


def test_cost_and_planes_per_iteration(logged: tuple[Solution, Path, Log]) -> None:
    solution, _, log = logged
    steps = list(range(len(solution.estimate.iterations)))
    assert len(steps) > 1
    assert _times(log["/solver/cost"], "iteration") == steps
    assert _times(log["/solver/cost"], "frame") == [], "iterations are not frames"
    batches = [chunk.to_record_batch() for chunk in log["/solver/cost"]]
    logged_costs = np.concatenate([np.ravel(batch.column("Scalars:scalars").to_pylist()) for batch in batches])
    assert sorted(logged_costs) == pytest.approx(sorted(step.cost for step in solution.estimate.iterations))


def test_log_is_small_and_opens_with_a_blueprint(logged: tuple[Solution, Path, Log]) -> None:
    _, path, log = logged
    assert path.stat().st_size < 2e6
    assert "/summary" in log
    assert len(RrdReader(path).blueprints()) >= 1


def test_logging_changes_nothing(room: Path, logged: tuple[Solution, Path, Log]) -> None:
    silent = solve(load_scene(room), Config())
    for one, other in zip(silent.layout.planes, logged[0].layout.planes, strict=True):
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
