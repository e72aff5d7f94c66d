"""``gtlayout batch`` on scenes that are broken, crash, hang or eat memory: each is recorded, none costs another."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from common.batch_runs import batch
from gtlayout.batch.record import RECORD_FILE, SOLVE_LOG_FILE, Failure, Record, scene_folder
from gtlayout.batch.run_folder import read_run
from gtlayout.synth import SynthConfig, synthesize
from simulated.broken_scenes import BROKEN, link_scene, misbehave, wrongly_recorded

OPTIONS = ("--workers", "2", "--memory-limit", "1GiB")
MISBEHAVE: dict[str, tuple[Failure, str]] = {
    "bug": ("bug", "RuntimeError: a bug of the test"),
    "leave": ("died", "its process ended with status 7"),
    "memory": ("memory", "of memory"),
    "segfault": ("died", "its process died of SIGSEGV"),
}
"""Fault → what is recorded, and what is in the reason."""
INPUT = {how: of for how, of in BROKEN.items() if of[1] == "input"}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("small") / "room"
    synthesize(folder, SynthConfig(frames=12, width=160, height=120, oversample=1))
    return folder


def records_of(run: Path) -> dict[str, Record]:
    return read_run(run).records


def log_of(run: Path, scene: str) -> str:
    return (scene_folder(run, scene) / SOLVE_LOG_FILE).read_text(encoding="utf-8")


def test_every_fault_is_recorded_and_the_rest_is_solved(small: Path, tmp_path: Path) -> None:
    root, run, log = tmp_path / "scenes", tmp_path / "run", tmp_path / "log"
    changes = {name: partial(misbehave, name) for name in MISBEHAVE} | {name: of[0] for name, of in INPUT.items()}
    changes |= {"once": partial(misbehave, "killed", once=True), "good": lambda _folder: None}
    for name, change in changes.items():
        link_scene(small, root / name)
        change(root / name)

    with batch(root, run, OPTIONS, log) as command:
        assert command.wait() == 3, log.read_text()
    records = records_of(run)
    assert not wrongly_recorded(
        {name: root / name for name in ("good", "once", *INPUT)}, {how: how for how in INPUT}, records
    )
    assert {name: records[name].failure for name in MISBEHAVE} == {name: of[0] for name, of in MISBEHAVE.items()}
    for name, (_, reason) in MISBEHAVE.items():
        assert reason in records[name].reason
    again = {name for name, record in records.items() if record.attempts == 2}
    assert again == {"once", "leave", "memory", "segfault"}
    assert "Segmentation fault" in log_of(run, "segfault")
    assert "sitecustomize.py" in log_of(run, "segfault")
    assert "Traceback" in log_of(run, "bug")
    for name, record in records.items():
        files = {path.name for path in scene_folder(run, name).iterdir()}
        assert (files == {RECORD_FILE, SOLVE_LOG_FILE}) == (record.status == "failed")

    # What may go well another time is tried again, and nothing else: markers are hidden, the scenes unchanged.
    for name in MISBEHAVE:
        (root / name / ".fault").unlink()
    with batch(root, run, OPTIONS, log) as command:
        assert command.wait() == 3, log.read_text()
    later = records_of(run)
    assert {name for name in later if later[name] == records[name]} == {"bug", "good", "once", *INPUT}
    assert {later[name].status for name in ("leave", "memory", "segfault")} == {"accepted"}


def test_what_hangs_is_stopped_and_says_where_it_was(small: Path, tmp_path: Path) -> None:
    """Only scenes that never end, so that time plays no part but for how long this takes."""
    root, run, log = tmp_path / "scenes", tmp_path / "run", tmp_path / "log"
    for name in ("hang", "stuck"):
        link_scene(small, root / name)
        misbehave(name, root / name)
    with batch(root, run, [*OPTIONS, "--timeout", "2"], log) as command:
        assert command.wait() == 3, log.read_text()
    for name, record in records_of(run).items():
        assert (record.failure, record.attempts) == ("timeout", 2)
        assert record.reason.startswith("not done in 2 s")
        assert f"in {name}" in log_of(run, name)
