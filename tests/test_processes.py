"""Work in several processes: all of it is done, and whatever ends it early leaves no process behind."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from pathlib import Path

import pytest
from measures import measure

from gtlayout.errors import GtlayoutError
from gtlayout.processes import Died, in_processes, outcomes


def _ignored(_done: int, _total: int) -> None:
    pass


def test_all_is_worked_on_once(tmp_path: Path) -> None:
    folders = [tmp_path / str(number) for number in range(5)]
    for folder in folders:
        folder.mkdir()
    told: list[tuple[int, int]] = []
    threads = os.environ.get("OMP_NUM_THREADS")
    in_processes(measure, folders, 2, lambda done, total: told.append((done, total)))
    assert told == [(done, 5) for done in range(6)]
    assert [(folder / ".runs").read_text() for folder in folders] == ["x"] * 5
    assert os.environ.get("OMP_NUM_THREADS") == threads
    assert not multiprocessing.active_children()


def test_nothing_to_do_starts_no_process() -> None:
    told: list[tuple[int, int]] = []
    in_processes(measure, [], 3, lambda done, total: told.append((done, total)))
    assert told == [(0, 0)]


def test_a_known_problem_comes_through_and_ends_it(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("raises", "never")]
    for folder in folders:
        folder.mkdir()
    with pytest.raises(GtlayoutError, match="no luck here"):
        in_processes(measure, folders, 1, _ignored)
    assert not (tmp_path / "never/.runs").exists()
    assert not multiprocessing.active_children()


def test_a_process_that_is_killed_is_a_known_problem_and_one_that_ends_is_a_bug(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(GtlayoutError, match="SIGKILL"):
        in_processes(signal.raise_signal, [signal.SIGKILL], 1, _ignored)
    with pytest.raises(RuntimeError, match="a process ended"):
        in_processes(signal.raise_signal, [999], 1, _ignored)
    assert "Traceback" in capfd.readouterr().err
    assert not multiprocessing.active_children()


def test_ctrl_c_stops_those_at_work() -> None:
    def interrupt(done: int, _total: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        in_processes(time.sleep, [0, 3600], 2, interrupt)
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("processes", [1, 3])
def test_who_dies_costs_one_item(processes: int) -> None:
    """``abs`` answers; a process that raises a signal, or cannot tell its result, dies."""
    items = [-1, signal.SIGKILL, -2, signal.SIGKILL, signal.SIGSEGV, -3]
    found = dict(outcomes(_signal_or_abs, items, processes))
    assert found == {
        0: 1,
        1: Died(-signal.SIGKILL),
        2: 2,
        3: Died(-signal.SIGKILL),
        4: Died(-signal.SIGSEGV),
        5: 3,
    }
    assert not multiprocessing.active_children()


def test_who_takes_no_more_stops_all() -> None:
    found = outcomes(time.sleep, [0, 3600, 3600], 2)
    assert next(found) == (0, None)
    found.close()
    assert not multiprocessing.active_children()


def _signal_or_abs(number: int) -> int:
    if number > 0:
        signal.raise_signal(number)
    return abs(number)
