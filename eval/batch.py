"""Data sets: does a run hold out broken scenes and lost processes, does its memory stay, what does the engine cost?"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import psutil
from cyclopts import Parameter
from cyclopts.validators import Number

from common.batch_runs import MARK, batch, course, differences, ends_s, environment
from common.command_line import exit_status, new_app
from common.dask_processes import DaskProcesses, dask_processes, kill, left_behind
from common.memory_use import Use, Watch, slope_kib
from common.metrics import Metric, write_tables
from common.plots import courses
from gtlayout.batch.run_folder import is_run, read_run
from gtlayout.batch.scenes import find_scenes
from gtlayout.errors import GtlayoutError
from simulated.broken_scenes import make_data_set, wrongly_recorded

PLAIN_LOOP = Path(__file__).parent / "common/plain_loop.py"
VICTIMS = ("client", "worker", "nanny", "scheduler")
MEMORY = "1.5GiB"
"""Of a worker with its scene; what eats memory is to reach it soon."""
END_S = 3600.0
"""A run of a thousand scenes that takes longer to end, once nothing disturbs it any more, hangs."""

Positive = Annotated[int, Parameter(validator=Number(gte=1))]
app = new_app("batch", __doc__)


@app.command
def trial(
    root: Annotated[Path, Parameter(name="ROOT")],
    /,
    *,
    out: Path,
    workers: Positive = 2,
    timeout: Positive = 30,
    every: Positive = 20,
) -> int:
    """Break some of many good scenes, run them all, and compare what is recorded with what was done.

    Exit status 1 when a scene is not recorded as it should be.

    Parameters
    ----------
    root
        Folder of synthetic scenes; they are linked, not changed.
    out
        A new folder: the data set, the run, tables and a plot of memory.
    workers
        Of the local cluster.
    timeout
        Seconds for a scene.
    every
        One scene in so many is broken.
    """
    scenes = find_scenes([root], out)
    data, run = new_folders(out, "data", "run")
    broken = make_data_set(scenes, data, every)
    options = ["--workers", str(workers), "--timeout", str(timeout), "--memory-limit", MEMORY]
    began_s = time.time()
    with batch(data, run, options, out / "batch.log") as command, Watch(command.pid) as watch:
        status = command.wait()
    ended_s = time.time()
    records = read_run(run).records
    end_s = ends_s(run, records)
    wrong = wrongly_recorded(scenes, broken, records)
    wrong += [] if status == 3 else [f"exit status {status}, not 3"]
    wrong += [f"process {pid} is left" for pid in left_behind(MARK, str(os.getpid()))]
    metrics = [
        *course(records, end_s, began_s, ended_s, workers),
        Metric("broken", len(broken), "", None),
        Metric("wrong", len(wrong), "", False),
        *memory(watch.seen, sorted(end_s.values()), out / "memory.png"),
    ]
    write_tables(out, "trial", {run.name: metrics}, "run")
    return exit_status_of(out / "trial.md", wrong)


def memory(seen: list[Use], finished_s: Sequence[float], plot: Path) -> list[Metric]:
    """Largest resident memory, and by how much it grows from scene to scene; drawn over the number of scenes done."""
    done = np.searchsorted(finished_s, [use.time_s for use in seen]).astype(np.float64)
    courses_mib = {
        name: np.array([getattr(use, name) for use in seen], dtype=np.float64)
        for name in ("client", "workers", "solvers")
    }
    courses(plot, done, courses_mib, "scenes done", "resident memory, MiB")
    metrics = []
    for name, mib in courses_mib.items():
        metrics.append(Metric(f"{name}_peak", mib.max(initial=0.0), "MiB", False))
        metrics.append(Metric(f"{name}_growth", slope_kib(done, mib), "KiB a scene", False))
    return metrics


@dataclass(frozen=True)
class Kill:
    """One of many."""

    victim: str
    at_s: float
    """After the command was last started."""
    finished: int
    """Scenes, by then."""


@app.command
def kills(
    root: Annotated[Path, Parameter(name="ROOT")],
    /,
    *,
    out: Path,
    count: Positive = 20,
    within: Annotated[float, Parameter(validator=Number(gt=0))] = 15.0,
    every: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    timeout: Positive = 600,
    seed: int = 0,
) -> int:
    """Kill client, workers, their nannies or the scheduler at random moments, and compare with an undisturbed run.

    Whatever is gone is started again, as is the same command until it is done; then the set is begun anew, until there
    were enough kills. Exit status 1 when results differ, a broken scene is not recorded as such, or anything is left.

    Parameters
    ----------
    root
        Folder of scenes.
    out
        A new folder: runs and tables.
    count
        Kills.
    within
        Each comes at most so many seconds after the command was started, or after the one before.
    every
        One scene in so many is broken first, as in trial; 0 = none.
    timeout
        Seconds for a scene.
    seed
        Of victims and moments.
    """
    scenes = find_scenes([root], out)
    undisturbed, logs, data = new_folders(out, "undisturbed", "dask", "data")
    broken = make_data_set(scenes, data, every) if every else {}
    root = data if every else root
    done: list[Kill] = []
    wrong: list[str] = []
    rng = random.Random(seed)
    victims = [victim for _ in range(0, count, len(VICTIMS)) for victim in rng.sample(VICTIMS, len(VICTIMS))][:count]
    with dask_processes(logs, 2, environment()) as dask:
        options = ["--scheduler", dask.address, "--timeout", str(timeout)]
        with batch(root, undisturbed, options, log := out / "undisturbed.log") as command:
            status = finish(command, log)
        wrong += [] if status in (0, 3) else [f"undisturbed: exit status {status}"]
        wrong += wrongly_recorded(scenes, broken, read_run(undisturbed).records)
        while len(done) < count and not wrong:
            run = out / f"disturbed-{len(done)}"
            done += disturb(dask, root, run, options, victims[len(done) :], within, rng)
            wrong += [f"{run.name}: {line}" for line in differences(undisturbed, run, scenes)]
            left = left_behind(MARK, str(os.getpid()), orphans_only=True)
            wrong += [f"{run.name}: process {pid} is left" for pid in left]
    rows = {
        f"{number} {one.victim}": [Metric("at", one.at_s, "s", None), Metric("finished", one.finished, "", None)]
        for number, one in enumerate(done, start=1)
    }
    write_tables(out, "kills", rows, "kill")
    return exit_status_of(out / "kills.md", wrong)


def disturb(
    dask: DaskProcesses,
    root: Path,
    run: Path,
    options: Sequence[str],
    victims: Sequence[str],
    within_s: float,
    rng: random.Random,
) -> list[Kill]:
    """Run the command again and again until it is done, killing one after the other of ``victims`` meanwhile.

    Raises GtlayoutError when it hangs, or ends with a status that has no such cause.
    """
    done: list[Kill] = []
    log = run.with_suffix(".log")
    while True:
        dask.restore()
        with batch(root, run, options, log) as command:
            start = time.monotonic()
            while len(done) < len(victims) and not ended(command, rng.uniform(0, within_s)):
                victim = victims[len(done)]
                finished = len(read_run(run).records) if is_run(run) else 0
                strike(victim, command, dask, rng)
                done.append(Kill(victim, time.monotonic() - start, finished))
                print(f"{run.name}: {victim} killed, {finished} scenes finished", file=sys.stderr)
                dask.restore()
            status = finish(command, log)
        if status in (0, 3):
            return done
        if status not in (1, -signal.SIGKILL):
            raise GtlayoutError(f"the command ended with status {status}: see {log}")


def strike(victim: str, command: subprocess.Popen[bytes], dask: DaskProcesses, rng: random.Random) -> None:
    """Kill one process with SIGKILL; no other one is told."""
    name = rng.choice(dask.workers)
    processes = {
        "client": lambda: psutil.Process(command.pid),
        "worker": lambda: dask.worker(name),
        "nanny": lambda: dask.nanny(name),
        "scheduler": lambda: dask.nanny("scheduler"),
    }
    kill([processes[victim]()])


def finish(command: subprocess.Popen[bytes], log: Path) -> int:
    """Its exit status. Raises GtlayoutError when it never ends."""
    if not ended(command, END_S):
        command.kill()
        raise GtlayoutError(f"the command hangs: see {log}")
    return command.returncode


def ended(command: subprocess.Popen[bytes], wait_s: float) -> bool:
    """Whether it ends within that time."""
    try:
        command.wait(wait_s)
    except subprocess.TimeoutExpired:
        return False
    return True


@app.command
def scaling(root: Annotated[Path, Parameter(name="ROOT")], /, *, out: Path, repeats: Positive = 1) -> None:
    """Throughput of one worker and of two, and of a plain loop that does the same without an engine.

    Parameters
    ----------
    root
        Folder of scenes.
    out
        A new folder: runs and a table.
    repeats
        Times that each is run, in turn; the fastest counts.
    """
    scenes = find_scenes([root], out)
    (runs,) = new_folders(out, "runs")
    plain_s: list[float] = []
    found: dict[int, list[list[Metric]]] = {1: [], 2: []}
    for number in range(repeats):
        plain_s.append(time_plain_loop(runs / f"plain-{number}", scenes))
        for workers, measured in found.items():
            run = runs / f"{workers}-workers-{number}"
            began_s = time.time()
            with batch(root, run, ["--workers", str(workers)], out / f"{run.name}.log") as command:
                if command.wait() not in (0, 3):
                    raise GtlayoutError(f"{run.name} ended with status {command.returncode}: see {out}")
            ended_s = time.time()
            measured.append(course(read_run(run).records, ends_s(run, scenes), began_s, ended_s, workers))
    write_tables(out, "scaling", scaling_rows(min(plain_s), len(scenes), found), "run")
    print((out / "scaling.md").read_text(encoding="utf-8"))


def time_plain_loop(out: Path, scenes: Mapping[str, Path]) -> float:
    """Seconds for all scenes."""
    command = [sys.executable, str(PLAIN_LOOP), str(out), *map(str, scenes.values())]
    ran = subprocess.run(command, env=environment(), capture_output=True, text=True, check=False)
    if ran.returncode:
        raise GtlayoutError(f"the plain loop failed: {ran.stderr.strip()}")
    return float(json.loads(ran.stdout.splitlines()[-1])["seconds"])


def scaling_rows(plain_s: float, scenes: int, found: Mapping[int, list[list[Metric]]]) -> dict[str, list[Metric]]:
    """The fastest run of each number of workers, its rate as a multiple of one worker's and of the plain loop's."""
    rows = {"plain loop": [Metric("span", plain_s, "s", False), Metric("rate", scenes / plain_s * 60, "1/min", True)]}
    plain = rate_of(rows["plain loop"])
    one = max(map(rate_of, found[1]))
    for workers, measured in found.items():
        best = max(measured, key=rate_of)
        ratios = [
            Metric("rate_to_one_worker", rate_of(best) / one, "", True),
            Metric("rate_to_plain_loop", rate_of(best) / plain, "", True),
        ]
        rows[f"{workers} worker{'s' if workers > 1 else ''}"] = [*best, *ratios]
    return rows


def rate_of(metrics: list[Metric]) -> float:
    """Scenes a minute."""
    return next(metric.value for metric in metrics if metric.key == "rate")


def new_folders(out: Path, *names: str) -> list[Path]:
    """Paths in ``out`` for what is made. Raises GtlayoutError when ``out`` holds something already."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise GtlayoutError(f"{out} exists and is not an empty folder: name a new one")
    return [out / name for name in names]


def exit_status_of(table: Path, wrong: list[str]) -> int:
    """Print the table and what is wrong; the exit status."""
    print(table.read_text(encoding="utf-8"))
    for line in wrong:
        print(line, file=sys.stderr)
    print(f"Results: {table.parent}")
    return 1 if wrong else 0


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
