"""``gtlayout batch --scheduler``: a scheduler and two workers that were started by hand, as processes of their own."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

import pytest
from distributed import Client

from common.batch_runs import MARK, batch, environment
from common.dask_processes import DaskProcesses, dask_processes, kill, left_behind
from gtlayout.batch.record import scene_folder
from gtlayout.batch.run_folder import read_run
from gtlayout.quality.headline import Word
from gtlayout.synth import SynthConfig, synthesize
from simulated.broken_scenes import link_scene, misbehave

FILES = {"layout.json", "layout.glb", "layout.ply", "quality.json", "report.html", "thumbnail.jpg", "record.json"}


@pytest.fixture
def dask(tmp_path: Path) -> Iterator[DaskProcesses]:
    with dask_processes(tmp_path / "dask", 2, environment()) as processes:
        yield processes
    assert not left_behind(MARK, str(os.getpid()))


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("small") / "room"
    synthesize(folder, SynthConfig(frames=12, width=160, height=120, oversample=1))
    return folder


def test_scenes_are_solved_by_both_workers_though_one_is_lost(dask: DaskProcesses, room: Path, tmp_path: Path) -> None:
    """One scene kills its own process, another the worker that waits for it; the first time that they are solved."""
    root, run, log = (tmp_path / name for name in ("scenes", "run", "log"))
    names = ["a", "b", "c crashes", "d loses its worker", "e"]
    for name in names:
        link_scene(room, root / name)
    misbehave("segfault", root / "c crashes", once=True)
    misbehave("lose_worker", root / "d loses its worker", once=True)

    with Client(dask.address, set_as_default=False) as client:
        client.get_task_stream()  # begins to note where tasks run
        with batch(root, run, ["--scheduler", dask.address], log) as command:
            assert command.wait() == 0, log.read_text()
        solved_by = {task["worker"] for task in client.get_task_stream() if task["status"] == "OK"}
    assert len(solved_by) >= 2
    assert not [*root.glob("*/.fault")]  # both have happened
    found = read_run(run)
    assert sorted(found.records) == names
    assert {record.status for record in found.records.values()} == {"accepted"}
    ((word, why),) = {(record.headline, record.headline_reason) for record in found.records.values()}
    quality = json.loads((scene_folder(run, "a") / "quality.json").read_text(encoding="utf-8"))
    assert (word, why) == (quality["headline"]["word"], "; ".join(quality["headline"]["reasons"]))
    assert all((word == "trust") or record.reason.startswith(why) for record in found.records.values())
    assert (
        f"5 scenes: {', '.join(f'{5 * (each == word)} {each}' for each in get_args(Word))}, 0 failed; 5 accepted"
        in (log.read_text())
    )
    assert [found.records[name].attempts for name in names] == [1, 1, 2, 1, 1]
    layouts = {(scene_folder(run, name) / "layout.json").read_bytes() for name in names}
    assert len(layouts) == 1  # it is the same room under five names
    for name in names:
        assert {path.name for path in scene_folder(run, name).iterdir()} >= FILES
    assert (run / "run.parquet").is_file()
    assert len((run / "run.csv").read_text(encoding="utf-8").splitlines()) == 1 + len(names)


def test_a_lost_scheduler_is_told_in_a_line_and_the_same_command_goes_on(
    dask: DaskProcesses, room: Path, tmp_path: Path
) -> None:
    """Lost while both workers are at a scene that hangs; the others are done."""
    root, run, log = (tmp_path / name for name in ("scenes", "run", "log"))
    for name in ("a", "b", "c hangs", "d hangs"):
        link_scene(room, root / name)
    for hanging in root.glob("* hangs"):
        misbehave("hang", hanging, once=True)

    options = ["--scheduler", dask.address]
    with batch(root, run, options, log) as command:
        wait_for(lambda: not [*root.glob("*/.fault")] and len([*run.glob("scenes/*/record.json")]) == 2)
        kill([dask.nanny("scheduler")])
        assert command.wait() == 1
    said = log.read_text(encoding="utf-8").splitlines()
    assert said[-1].startswith("gtlayout: lost the Dask scheduler")
    assert not [line for line in said[:-1] if not line.startswith(("4 scenes,", "0/4", "1/4", "2/4"))]
    before = {path: path.read_bytes() for path in run.glob("scenes/*/*")}
    assert {path.parent.name for path in before} == {"a", "b"}
    dask.close()
    dask.restore()
    with batch(root, run, options, log) as command:
        assert command.wait() == 0, log.read_text()
    assert {path: path.read_bytes() for path in before} == before
    assert len(read_run(run).records) == 4


def wait_for(happened: Callable[[], bool]) -> None:
    until = time.monotonic() + 120
    while not happened():
        assert time.monotonic() < until
        time.sleep(0.1)
