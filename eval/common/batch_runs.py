"""Runs of ``gtlayout batch`` as processes of their own, and what their records and folders say afterwards."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from common.command_line import GTLAYOUT
from common.metrics import Metric
from gtlayout.batch.record import RECORD_FILE, SOLVE_LOG_FILE, Record, read_record, scene_folder
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json
from gtlayout.processes import ONE_THREAD
from gtlayout.results.names import REPORT_FILE, TIMINGS_FILE
from simulated.broken_scenes import FAULTS

MARK = "GTLAYOUT_EVAL"
"""In the environment of all that a script starts, with its process id: so that it finds what it left behind."""
VARYING = {TIMINGS_FILE, REPORT_FILE, RECORD_FILE, SOLVE_LOG_FILE}
"""Files that hold times: no two runs write the same."""


def environment() -> dict[str, str]:
    """For all that is started: one thread each, faults where a scene asks for them, our mark."""
    path = os.pathsep.join([str(FAULTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {**os.environ, **ONE_THREAD, MARK: str(os.getpid()), "PYTHONPATH": path}


@contextmanager
def batch(root: Path, run: Path, options: Sequence[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """``gtlayout batch root --out run`` with ``options``; what it prints goes to ``log``. Ends when it does."""
    log.parent.mkdir(parents=True, exist_ok=True)
    command = [*GTLAYOUT, "batch", str(root), "--out", str(run), *options]
    with log.open("ab") as printed, subprocess.Popen(command, env=environment(), stdout=printed, stderr=printed) as one:
        yield one


def ends_s(run: Path, scenes: Iterable[str]) -> dict[str, float]:
    """Scene → when it was finished, seconds since 1970, as its file system has it: records have whole seconds."""
    return {scene: (scene_folder(run, scene) / RECORD_FILE).stat().st_mtime for scene in scenes}


def course(
    records: Mapping[str, Record], end_s: Mapping[str, float], began_s: float, ended_s: float, workers: int
) -> list[Metric]:
    """Where the time of a run went, from the call of the command (``began_s``) to its end (``ended_s``).

    ``start_up`` is the time before the first scene is begun, ``wind_up`` that after the last one is finished. Between
    the two lies ``span``; ``overhead`` is the share of it that workers did not spend on attempts that are recorded as
    solved: waiting, hashing, moving results, and all that was lost to scenes that failed.

    Args:
        records: of all scenes of the run.
        end_s: when each was finished, of ``ends_s``.
        began_s: when the command was called, seconds since 1970.
        ended_s: when it ended.
        workers: of one thread each.
    """
    seconds = {name: record.seconds or 0.0 for name, record in records.items() if record.status != "failed"}
    first, last = min(end_s[name] - seconds[name] for name in seconds), max(end_s.values())
    span, solving = last - first, sum(seconds.values())
    return [
        Metric("scenes", len(records), "", None),
        Metric("wall", ended_s - began_s, "s", False),
        Metric("start_up", first - began_s, "s", False),
        Metric("span", span, "s", False),
        Metric("wind_up", ended_s - last, "s", False),
        Metric("seconds_per_scene", solving / len(seconds), "s", False),
        Metric("rate", len(records) / span * 60, "1/min", True),
        Metric("overhead", 1 - solving / (workers * span), "", False),
    ]


def differences(undisturbed: Path, run: Path, scenes: Mapping[str, Path]) -> list[str]:
    """What is otherwise in ``run`` than in ``undisturbed``, or is no whole file, or should not be there."""
    found = []
    for scene in scenes:
        one, other = scene_folder(undisturbed, scene), scene_folder(run, scene)
        names = {path.name for path in one.iterdir()}
        there = {path.name for path in other.iterdir()} if other.is_dir() else set()
        found += [f"{scene}: {name} is in one only" for name in sorted(names ^ there)]
        for name in sorted(names & there):
            same = whole(other / name) if name in VARYING else (one / name).read_bytes() == (other / name).read_bytes()
            found += [] if same else [f"{scene}: {name} differs"]
    known = {path.name for path in undisturbed.iterdir()}
    found += [f"{path.name} is left" for path in sorted(run.iterdir()) if path.name not in known]
    beside = [path for path in run.parent.iterdir() if path.name.startswith(f".{run.name}")]
    return [*found, *(f"{path.name} is left beside {run.name}" for path in beside)]


def whole(path: Path) -> bool:
    """Whether the file is complete: one of those that hold times."""
    try:
        if path.name == RECORD_FILE:
            return bool(read_record(path))
        if path.name == TIMINGS_FILE:
            return bool(read_json(path))
    except GtlayoutError:
        return False
    return path.name != REPORT_FILE or path.read_text(encoding="utf-8").rstrip().endswith("</html>")
