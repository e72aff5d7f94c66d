"""What the script that tries out data sets computes, without a run."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest

import batch
from common.batch_runs import course, differences
from common.memory_use import Use, slope_kib, use_of
from common.metrics import Metric
from gtlayout.batch.record import Record, scene_folder, write_record
from gtlayout.io.files import write_atomic
from simulated.broken_scenes import BROKEN, make_data_set, wrongly_recorded


def value(metrics: list[Metric], key: str) -> float:
    return next(metric.value for metric in metrics if metric.key == key)


def solved(name: str, seconds: float = 1.0) -> Record:
    return Record(name, "accepted", seconds=seconds)


@pytest.fixture
def scenes(tmp_path: Path) -> dict[str, Path]:
    """Twelve folders that look like scenes from afar."""
    found = {f"{number:02d}": tmp_path / f"good/{number:02d}" for number in range(12)}
    for folder in found.values():
        (folder / "images").mkdir(parents=True)
        for name in ("transforms.json", "annotations.json"):
            (folder / name).write_text("{}")
    return found


def test_one_scene_in_so_many_is_broken_in_every_way_and_the_good_ones_stay(
    scenes: dict[str, Path], tmp_path: Path
) -> None:
    out = tmp_path / "data"
    broken = make_data_set(scenes, out, every=2)
    assert list(broken) == [f"{number:02d}" for number in range(1, 12, 2)]
    assert list(broken.values()) == list(BROKEN)
    assert {path.name for path in (out / "01").iterdir()} == {"images", "annotations.json"}
    assert (out / "07/.fault").read_text() == "hang"
    assert (out / "05/annotations.json").read_bytes() != b"{}"
    for name, folder in scenes.items():
        assert (folder / "annotations.json").read_text() == "{}", name
        assert {path.name for path in folder.iterdir()} == {"images", "transforms.json", "annotations.json"}


def test_wrong_records_are_listed(scenes: dict[str, Path]) -> None:
    some = dict(list(scenes.items())[:5])
    broken = {"01": "hangs", "02": "no images", "03": "crashes"}
    records = {
        "00": Record("00", "failed", "died", "its process died of SIGSEGV"),
        "01": Record("01", "failed", "timeout", "not done in 3 s"),
        "02": solved("02"),
        "03": Record("03", "failed", "died"),
    }
    assert [line.partition(":")[0] for line in wrongly_recorded(some, broken, records)] == ["00", "02", "03", "04"]


def test_where_the_time_went() -> None:
    """Two workers for 10 s, of which they solve 16 s; the scene that failed took the other 4."""
    records = {name: solved(name, seconds) for name, seconds in (("a", 5.0), ("b", 6.0), ("c", 5.0))}
    records["d"] = Record("d", "failed", "timeout", "not done in 2 s", seconds=2.0)
    end_s = {"a": 1007.0, "b": 1008.0, "c": 1012.0, "d": 1012.0}
    found = course(records, end_s, began_s=1000.0, ended_s=1015.5, workers=2)
    assert value(found, "start_up") == pytest.approx(2)
    assert value(found, "span") == pytest.approx(10)
    assert value(found, "wind_up") == pytest.approx(3.5)
    assert value(found, "overhead") == pytest.approx(0.2)
    assert value(found, "rate") == pytest.approx(24)


def test_growth_leaves_out_what_is_loaded_in_the_beginning() -> None:
    done = np.arange(101.0)
    mib = np.where(done < 10, 10 * done, 100) + 0.5 * done
    assert slope_kib(done, mib) == pytest.approx(512)
    assert np.isnan(slope_kib([3, 3], [1, 2]))
    assert np.isnan(slope_kib([], []))


def test_memory_is_drawn_over_scenes_done(tmp_path: Path) -> None:
    seen = [Use(float(second), 100 + second, 300, 500) for second in range(10)]
    found = batch.memory(seen, np.arange(0.5, 10).tolist(), tmp_path / "memory.png")
    assert value(found, "client_growth") == pytest.approx(1024)
    assert value(found, "workers_growth") == pytest.approx(0, abs=1e-6)
    assert value(found, "solvers_peak") == 500
    assert (tmp_path / "memory.png").is_file()


def test_memory_of_a_process_and_what_it_started() -> None:
    sleeper = [sys.executable, "-c", "print(flush=True); input()", "gtlayout.batch.solver"]
    with psutil.Popen(sleeper, stdin=-1, stdout=-1) as child:
        child.stdout.readline()  # before that it may still be what it was forked from
        use = use_of(psutil.Process(os.getpid()))
        child.kill()
    assert use.client > 20
    assert use.solvers > 1


def test_differences_between_runs(tmp_path: Path) -> None:
    scenes = {"a": tmp_path, "b/c": tmp_path}
    one, two = tmp_path / "one/run", tmp_path / "two/run"
    for run in (one, two):
        for scene in scenes:
            folder = scene_folder(run, scene)
            write_atomic(folder / "layout.json", "{}")
            write_atomic(folder / "log.txt", str(run))
            write_atomic(folder / "report.html", f"<html>{run}</html>\n")
            write_record(folder / "record.json", solved(scene, seconds=len(str(run))))
    assert differences(one, two, scenes) == []
    (scene_folder(two, "b/c") / "layout.json").write_text("{ }")
    (scene_folder(two, "b/c") / "report.html").write_text("<html>")
    (scene_folder(two, "a") / "record.json").write_text("{")
    (scene_folder(two, "a") / ".layout.json.1.tmp").write_text("{")
    (two / ".left").mkdir()
    assert differences(one, two, scenes) == [
        "a: .layout.json.1.tmp is in one only",
        "a: record.json differs",
        "b/c: layout.json differs",
        "b/c: report.html differs",
        ".left is left",
    ]


def test_rates_are_compared_with_one_worker_and_with_the_plain_loop() -> None:
    found = {
        1: [[Metric("rate", 20.0, "1/min", True)], [Metric("rate", 25.0, "1/min", True)]],
        2: [[Metric("rate", 45.0, "1/min", True)], [Metric("rate", 30.0, "1/min", True)]],
    }
    rows = batch.scaling_rows(60.0, 30, found)
    assert value(rows["plain loop"], "rate") == 30
    assert value(rows["2 workers"], "rate_to_one_worker") == pytest.approx(1.8)
    assert value(rows["1 worker"], "rate_to_plain_loop") == pytest.approx(25 / 30)


def test_what_is_there_already_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out/file").write_text("mine")
    scene = tmp_path / "scenes/a"
    (scene / "images").mkdir(parents=True)
    assert batch.main(["scaling", str(tmp_path / "scenes"), "--out", str(tmp_path / "out")]) == 1
    assert "not an empty folder" in capsys.readouterr().err
