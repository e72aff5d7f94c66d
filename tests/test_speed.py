"""The script that times solves, run on small scenes: shapes and ratios, never seconds. And what the seconds hang on."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import speed
from common import adam
from common.metrics import Metric, read_rows
from gtlayout.config import Config
from gtlayout.planes import graph
from gtlayout.planes.evidence import gather
from gtlayout.planes.problem import Problem
from gtlayout.planes.starts import best_start
from gtlayout.synth import SynthConfig, synthesize
from gtlayout.tracking.normalisation import Normalisation

SMALL = speed.Size(tracks=60, frames=60, key_frames=4)


def test_small_scenes_end_to_end(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A room, and a scene that cannot be solved, which costs only itself."""
    synthesize(tmp_path / "rooms/box", SynthConfig(frames=12, width=160, height=120, oversample=1))
    quick = adam.AdamConfig(max_iterations=20)
    monkeypatch.setattr(adam, "AdamConfig", lambda: quick)
    monkeypatch.setattr(speed, "GROWTH", {"1 ×": SMALL, "tracks 2 ×": replace(SMALL, tracks=120)})
    monkeypatch.setattr(speed, "KEY_FRAMES", (6, 12))
    out = tmp_path / "out"
    assert speed.main([str(tiny), str(tmp_path / "rooms"), "--out", str(out), "--runs", "2", "--repeats", "1"]) == 0
    printed = capsys.readouterr()
    assert printed.err.startswith(f"{tiny.parent.name}/{tiny.name}: ")
    ((name, row),) = read_rows(out / "scenes.json").items()
    assert name == "rooms/box"
    scene = _values(row)
    assert scene["command"] > 0
    assert 50 < scene["peak_memory"] < 4000
    assert scene["estimation"] <= scene["solve"]
    assert scene["estimation_share"] == pytest.approx(scene["estimation"] / scene["solve"])
    assert min(scene["start"], scene["graph"]) > 0
    stages = {name: _values(row) for name, row in read_rows(out / "stages.json").items()}
    assert list(stages) == ["rooms/box, elapsed", "rooms/box, CPU"]
    for taken in stages.values():
        parts = [value for name, value in taken.items() if name not in ("all", "floor", "times_the_floor")]
        assert {"import", "reading", "tracking", "estimation", "review", "saving"} < set(taken)
        assert taken["all"] == pytest.approx(sum(parts))
        assert taken["times_the_floor"] == pytest.approx(taken["all"] / taken["floor"])
    # Import, files and estimation are not following: the floor is far below.
    assert 0 < stages["rooms/box, CPU"]["floor"] < stages["rooms/box, CPU"]["tracking"]
    ((name, row),) = read_rows(out / "paper.json").items()
    paper = _values(row)
    only_what_was_run = {"gtlayout", "paper, R = 1", "ratio, R = 1", "paper, R = 2", "ratio, R = 2"}
    assert set(paper) == only_what_was_run
    assert paper["paper, R = 2"] > paper["paper, R = 1"]
    assert paper["ratio, R = 2"] == pytest.approx(paper["paper, R = 2"] / paper["gtlayout"])
    growth = {key: _values(of) for key, of in read_rows(out / "growth.json").items()}
    assert [of["tracks"] for of in growth.values()] == [60, 120]
    assert growth["1 ×"]["graph_ratio"] == growth["1 ×"]["start_ratio"] == 1
    marginals = {key: _values(of) for key, of in read_rows(out / "marginals.json").items()}
    assert [(of["planes"], of["elements"], of["tracks"]) for of in marginals.values()] == [
        (24, 24 * count, 20 * 24 * count) for count in (6, 12)
    ]
    assert min(of["scales"] + of["marginals"] for of in marginals.values()) > 0
    assert "| simulated | tracks | observations | planes | frames |" in printed.out


def test_wrong_usage_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert speed.main(["--out", str(tmp_path)]) == 1
    assert "name at least one scene folder" in capsys.readouterr().err
    assert speed.main([str(tmp_path), "--out", str(tmp_path), "--runs", "0"]) == 2


def test_sizes_are_what_they_are_called() -> None:
    """The stated case to a twentieth, and twice or four times of what the row says."""
    stated = speed.simulated(speed.GROWTH["1,500 tracks, 20,000 observations, 6 planes"])
    assert (len(stated.tracks), len(stated.instances)) == (1500, 6)
    assert len(stated.tracks.track) == pytest.approx(20_000, rel=0.05)
    planes = {name: size.walls + 2 for name, size in speed.GROWTH.items() if name.startswith("planes")}
    assert planes == {"planes 2 ×": 12, "planes 4 ×": 24}
    assert len(speed.simulated(replace(SMALL, walls=10)).instances) == 12


def test_ratios_are_to_the_first_row() -> None:
    rows = {"one": [Metric("graph", 0.5, "s", False)], "two": [Metric("graph", 2.0, "s", False)]}
    assert [_values(of)["graph_ratio"] for of in speed.grown(rows).values()] == [1.0, 4.0]


def test_peak_memory_is_the_commands_own() -> None:
    """200 MB more are seen, however large the process is that asks."""
    peaks = []
    for size in (0, 200_000_000):
        command = [sys.executable, "-c", f"b = bytearray({size}); b[::4096] = b'x' * len(b[::4096])"]
        ran = subprocess.run([sys.executable, str(speed.CHILD_USAGE), *command], capture_output=True, check=True)
        usage = json.loads(ran.stdout.splitlines()[-1])
        assert usage["status"] == 0
        peaks.append(usage["peak_bytes"])
    assert peaks[0] < 60e6
    assert peaks[1] - peaks[0] == pytest.approx(200e6, rel=0.05)


def test_exit_status_of_the_command_is_told() -> None:
    command = [sys.executable, str(speed.CHILD_USAGE), sys.executable, "-c", "raise SystemExit(3)"]
    ran = subprocess.run(command, capture_output=True, check=True)
    assert json.loads(ran.stdout)["status"] == 3


def test_python_is_not_called_for_every_landmark(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the speed hangs on: GTSAM's factors, each linearised by itself, are of planes and what joins them."""
    prepared, config = speed.simulated(replace(SMALL, tracks=600)), Config().estimation
    problems: list[Problem] = []

    def seen(*parts: Any) -> Problem:
        problems.append(Problem(*parts))
        return problems[-1]

    monkeypatch.setattr(graph, "Problem", seen)
    local = Normalisation.of(prepared.rays)
    evidence = gather(prepared, local, config)
    start = best_start(evidence, replace(config, starts=1), 0)
    cameras = [local.camera(frame.camera) for frame in prepared.scene.frames]
    graph.optimise_graph(cameras, prepared.tracks, evidence, start, config)
    assert problems
    for problem in problems:
        assert len(problem.landmarks.plane) == 600
        assert problem.graph.size() <= 2 * len(prepared.edges) + len(start) ** 2


def _values(metrics: list[Metric]) -> dict[str, float]:
    found = {metric.key: metric.value for metric in metrics}
    assert all(np.isfinite(value) for value in found.values())
    return found
