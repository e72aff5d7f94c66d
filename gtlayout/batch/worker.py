"""The work on a Dask worker: scenes are solved by processes of their own, and results are put into their places."""

from __future__ import annotations

import math
import platform
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import psutil
from distributed import Worker, get_worker
from distributed.diagnostics.plugin import WorkerPlugin

from gtlayout.batch.job import Answer, Attempt, Job
from gtlayout.batch.record import PASSING, RECORD_FILE, Record, scene_folder, write_record
from gtlayout.batch.results import CannotWriteError, finished, new_work_folder, publish
from gtlayout.batch.solver_process import SolverProcess
from gtlayout.errors import GtlayoutError

PLUGIN = "gtlayout-solvers"


@dataclass(frozen=True)
class Outcome:
    """The result of a job."""

    record: Record
    same: bool = False
    """Nothing was solved: the finished results are still good."""
    work: str | None = None
    """Folder of results that are not yet in their place, because the job had only some of the restarts."""


class Solvers(WorkerPlugin):
    """The solver processes of a worker: as many as it has threads that want one."""

    name = PLUGIN
    idempotent = True

    def setup(self, worker: Worker) -> None:
        """Begin without any."""
        self._worker = worker
        self._usage = psutil.Process()
        self._lock = threading.Lock()
        self._idle: list[SolverProcess] = []
        self._all: list[SolverProcess] = []

    def teardown(self, worker: Worker) -> None:
        """Stop all, whatever they do."""
        with self._lock:
            for process in self._all:
                process.close()

    @contextmanager
    def process(self) -> Iterator[SolverProcess]:
        """One for the calling thread, until it is done with it."""
        with self._lock:
            if not self._idle:
                self._idle.append(SolverProcess())
                self._all.append(self._idle[-1])
            process = self._idle.pop()
        try:
            yield process
        finally:
            with self._lock:
                self._idle.append(process)

    def memory_bytes(self) -> float:
        """Memory that each of them may use: the worker's limit without the worker's own share."""
        limit = self._worker.memory_manager.memory_limit
        return (limit - self._usage.memory_info().rss) / self._worker.state.nthreads if limit else math.inf


def work_on(job: Job) -> Outcome | None:
    """Do one job. A failed attempt is repeated once in a fresh process where that can help.

    Returns None when these restarts are not all, and none of them has a solution.

    Raises:
        CannotWriteError: the folder of the run does not take results, or is no longer this run's.
        GtlayoutError: this worker cannot solve anything.
    """
    solvers = get_worker().plugins[PLUGIN]
    assert isinstance(solvers, Solvers)
    place, work = scene_folder(Path(job.run), job.scene), new_work_folder(Path(job.lease))
    known = finished(place)
    attempt = Attempt(job, str(work), known.stamp if known else "", known.fingerprint if known else "")
    with solvers.process() as process:
        answer, peak_bytes = process.solve(attempt, solvers.memory_bytes)
        if again := answer.failure in PASSING:
            process.close()
            answer, peak_bytes = process.solve(attempt, solvers.memory_bytes)
    if answer.unwritable:
        raise CannotWriteError(answer.unwritable)
    if answer.no_solution or answer.same:
        shutil.rmtree(work, ignore_errors=True)
        return Outcome(_stamped(known, answer.figures["stamp"], place), same=True) if answer.same and known else None
    record = _record(job, answer, attempts=2 if again else 1, peak_memory_mib=peak_bytes / 2**20)
    if known and not answer.begun:
        return Outcome(record)  # Existing results may still be good, and are kept.
    return Outcome(publish(record, work, place)) if job.whole else Outcome(record, work=str(work))


def _record(job: Job, answer: Answer, *, attempts: int, peak_memory_mib: float) -> Record:
    failed = {"status": "failed", "failure": answer.failure, "reason": answer.reason} if answer.failure else {}
    return Record(
        **{"scene": job.scene, "source": job.source, **answer.figures, **failed},
        configuration=job.configuration,
        attempts=attempts,
        peak_memory_mib=peak_memory_mib,
        worker=platform.node(),
        finished=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def _stamped(record: Record, stamp: str, place: Path) -> Record:
    """The record with the inputs' present stamp, so that they need not be read the next time."""
    if record.stamp != stamp:
        record = replace(record, stamp=stamp)
        with suppress(GtlayoutError):
            write_record(place / RECORD_FILE, record)
    return record
