"""Killed at a handful of moments: what the script that does so in earnest runs, and what it notices."""

from __future__ import annotations

import random
import signal
import time
from pathlib import Path

import kills
from common.metrics import read_rows
from simulated.kill_bench import Bench, Command


def test_nothing_is_half_written(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert kills.main(["--out", str(out), "--count", "2", "--command", "export"]) == 0
    rows = {label: {one.key: one.value for one in row} for label, row in read_rows(out / "kills.json").items()}
    assert list(rows) == ["export, SIGKILL", "export, SIGTERM", "export, two at once"]
    for label, row in rows.items():
        assert row["wrong"] == 0
        assert row["runs"] == (1 if "two" in label else 2)
        assert row["writing"] == (0 if "two" in label else 1)


def careless(variant: str, to: Path) -> int:
    """In place, in two files: what a kill cuts short stays so."""
    for name in ("1", "2"):
        with (to / name).open("w") as file:
            for _ in range(10):
                file.write(variant)
                file.flush()
                time.sleep(0.002)
    return 0


def untidy(variant: str, to: Path) -> int:
    (to / f".{variant}.{time.monotonic_ns()}.tmp").touch()
    time.sleep(0.02)
    (to / "1").write_text(variant)
    return 0


def test_half_written_files_and_remains_are_noticed(tmp_path: Path) -> None:
    found = Bench(Command(careless), tmp_path / "careless", random.Random(0)).kill(6, signal.SIGKILL)
    assert any("neither old nor new: of 2 files" in line for line in found.wrong)
    bench = Bench(Command(untidy), tmp_path / "untidy", random.Random(0))
    assert any("is left for ever" in line for line in bench.kill(2, signal.SIGKILL).wrong)
    assert any("is left" in line for line in bench.pairs(1).wrong)


def test_a_next_run_that_fails_is_noticed(tmp_path: Path) -> None:
    found = Bench(Command(fails_the_second_time), tmp_path / "failing", random.Random(0)).kill(2, signal.SIGTERM)
    assert any("exit status 5" in line for line in found.wrong)


def fails_the_second_time(variant: str, to: Path) -> int:
    """It has run for both variants without harm."""
    if (to / "1").exists() and (to / "1").read_text() == "a":
        return 5
    (to / "1").write_text(variant)
    return 0
