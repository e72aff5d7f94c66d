"""The ablation on a small room, run for real, and what it makes of runs that fail."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import ablation
import benchmark_rooms
from common import adam
from common.metrics import Metric, read_rows
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.instances import Plane
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import prepare
from gtlayout.prepared.measurements import Prepared
from gtlayout.synth import SynthConfig


@pytest.fixture(scope="module")
def prepared(room: Path) -> Prepared:
    return prepare(load_scene(room), Config())


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """The paper's optimiser for 50 iterations only: the table's shape is tested, not its figures."""
    quick = adam.AdamConfig(max_iterations=50)
    monkeypatch.setattr(adam, "AdamConfig", lambda: quick)


def test_tables_have_every_row_of_both_methods(
    room: Path, tmp_path: Path, short: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ablation.main([str(room), "--out", str(tmp_path), "--runs", "2"]) == 0
    rows = read_rows(tmp_path / "room/summary.json")
    ours = {
        "gtlayout, R = 1",
        "gtlayout, R = 2",
        *(f"gtlayout, no {what}" for what in ("perpendicularity", "edges", "tracks")),
    }
    papers = {"paper, R = 1", "paper, R = 2", "paper, R = 2, lowest loss"}
    papers |= {f"paper, R = 1, no {what}" for what in ("perpendicularity", "edges", "tracks")}
    assert set(rows) == ours | papers
    values = {metric.key: metric.value for metric in rows["gtlayout, R = 1"]}
    assert values["iou"] > 0.95
    assert values["depth_error"] < 0.03
    assert values["iou_accepted"] == values["iou"]
    without = {metric.key: metric.value for metric in rows["gtlayout, no edges"]}
    assert without["iou"] < values["iou"]
    planes = read_rows(tmp_path / "room/planes.json")
    assert {"room: floor", "room: ceiling"} <= set(planes)
    assert all(np.isfinite(metric.value) for metrics in planes.values() for metric in metrics)
    for picture in ("iou.png", "depth_error_trimmed.png", "sigma_offset.png", "sigma_normal.png"):
        assert (tmp_path / "room" / picture).read_bytes().startswith(b"\x89PNG")
    assert "gtlayout, no edges" in capsys.readouterr().out


def test_both_methods_get_the_same_extents(prepared: Prepared) -> None:
    """The true planes give the same layout whichever method hands them over: nothing but planes differs."""
    planes, _ = ablation.own_planes(prepared, Config(), 0)

    def hand_over(_number: int) -> tuple[tuple[Plane, ...], float]:
        return planes, 1.0

    own = ablation.run_series(lambda n: ablation.own_planes(prepared, Config(), n), prepared, Config(), 1).best(1)
    handed = ablation.run_series(hand_over, prepared, Config(), 1).best(1)
    assert own is not None
    assert handed is not None
    assert own.iou == handed.iou


def test_the_best_run_is_that_of_highest_iou_or_of_lowest_loss(prepared: Prepared) -> None:
    layout = ablation.run_series(lambda n: ablation.own_planes(prepared, Config(), n), prepared, Config(), 1).best(1)
    assert layout is not None
    runs = [ablation.Candidate(layout.layout, iou, loss) for iou, loss in ((0.5, 3.0), (0.9, 2.0), (0.8, 1.0))]
    series = ablation.Series((None, *runs), np.array([1.0, 2.0, 4.0, 8.0]))
    assert series.best(1) is None
    assert series.best(2) is runs[0]
    assert series.best(4) is runs[1]
    assert series.best(4, by="loss") is runs[2]
    metrics = {metric.key: metric.value for metric in ablation.row(prepared, series, 4)}
    assert metrics["time"] == 15.0


def test_runs_without_a_layout_count_as_refused(prepared: Prepared) -> None:
    def fail(_number: int) -> tuple[tuple[Plane, ...], float]:
        raise GtlayoutError("nothing to see")

    series = ablation.run_series(fail, prepared, Config(), 2)
    metrics = {metric.key: metric.value for metric in ablation.row(prepared, series, 2)}
    assert (metrics["iou"], metrics["accepted"], metrics["recall"]) == (0.0, 0.0, 0.0)
    assert "depth_error" not in metrics


def test_scenes_that_fail_count_in_every_row(tmp_path: Path) -> None:
    rows = {"a": {"gtlayout, R = 1": [Metric("accepted", 1.0, "", True), Metric("iou", 0.9, "", True)]}}
    ablation.write_group(tmp_path, rows, 2, 1)
    metrics = {metric.key: metric.value for metric in read_rows(tmp_path / "summary.json")["gtlayout, R = 1"]}
    assert metrics["scenes"] == 3
    assert metrics["iou"] == pytest.approx(0.3)
    assert metrics["iou_accepted"] == pytest.approx(0.9)
    assert not (tmp_path / "planes.json").exists()


def test_several_folders_get_a_table_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three scenes in two folders, one of which fails."""

    def pretend(folder: Path, runs: int) -> dict[str, list[Metric]]:
        if folder.name == "broken":
            raise GtlayoutError("nothing to see")
        return {f"gtlayout, R = {runs}": [Metric("accepted", 1.0, "", True), Metric("iou", 0.9, "", True)]}

    monkeypatch.setattr(ablation, "measure", pretend)
    for scene in ("a/one", "a/broken", "b/two"):
        (tmp_path / scene).mkdir(parents=True)
        (tmp_path / scene / "transforms.json").write_text("{}")
    assert ablation.main([str(tmp_path / "a"), str(tmp_path / "b"), "--out", str(tmp_path / "out"), "--runs", "1"]) == 0
    assert "nothing to see" in capsys.readouterr().err
    for table, scenes, iou in (("a", 2, 0.45), ("b", 1, 0.9), ("all", 3, 0.6)):
        (row,) = read_rows(tmp_path / "out" / table / "summary.json").values()
        metrics = {metric.key: metric.value for metric in row}
        assert metrics["scenes"] == scenes
        assert metrics["iou"] == pytest.approx(iou)


def test_wrong_usage_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ablation.main(["--out", str(tmp_path)]) == 1
    assert "name at least one scene folder" in capsys.readouterr().err
    assert ablation.main([str(tmp_path / "nowhere"), "--out", str(tmp_path)]) == 1
    assert "no folder" in capsys.readouterr().err
    assert ablation.main([str(tmp_path), "--out", str(tmp_path), "--runs", "0"]) == 2


def test_benchmark_rooms_are_of_all_kinds_and_none_twice() -> None:
    configs = dict(benchmark_rooms.rooms())
    assert len(configs) == 65
    assert len({json.dumps(repr(config)) for config in configs.values()}) == 65
    kinds = {(name.split("/")[0], config.room) for name, config in configs.items()}
    assert len(kinds) == 7 * 5


def test_benchmark_rooms_are_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = SynthConfig(frames=3, width=64, height=64, oversample=1)
    monkeypatch.setattr(benchmark_rooms, "rooms", lambda: iter([("orbit/a", small), ("dolly/a", small)]))
    assert benchmark_rooms.main([str(tmp_path)]) == 0
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.jpg")}
    assert len(before) == 6
    assert benchmark_rooms.main([str(tmp_path)]) == 0
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.jpg")} == before
