"""A run, on the client: it hands out jobs a few at a time and records results as they arrive, until all are done."""

from __future__ import annotations

import os
import shutil
import time
import uuid
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from queue import Empty, SimpleQueue

from distributed import Client, Future
from distributed.comm.core import CommClosedError
from distributed.scheduler import KilledWorker

from gtlayout.batch.fingerprint import program
from gtlayout.batch.job import Job, Settings
from gtlayout.batch.progress import RunProgress
from gtlayout.batch.record import Record, scene_folder
from gtlayout.batch.results import CannotWriteError, finished, new_work_folder, publish
from gtlayout.batch.run_folder import recorded, write_run
from gtlayout.batch.run_tables import write_tables
from gtlayout.batch.worker import Outcome, Solvers, work_on
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.report import plotly_file

LEASE, GONE = ".in-progress-", ".gone-"
"""Folders in that of the run: for the work of one session, and for work that is no longer wanted."""
AHEAD = 2
"""Jobs handed out per thread of the cluster: one in progress and one next. The scheduler never holds more."""
LOOK_EVERY_S = 1.0
TABLES_EVERY_S = 5.0
TABLES_SHARE = 0.02
"""Largest share of the time that is spent on writing the tables."""
RETRIES = 1
"""Retries of jobs that a worker could not begin."""


def run_batch(
    client: Client, scenes: Mapping[str, Path], run: Path, settings: Settings, timeout_s: float, progress: RunProgress
) -> dict[str, Record]:
    """Solve the ``scenes`` (name → folder) into the folder ``run``, except those whose results are still good.

    Returns the record of each. If it ends early, finished scenes stay finished, and the same call continues.

    Raises:
        GtlayoutError: ``run`` cannot be written, or the scheduler is lost.
    """
    code = program()
    configuration = settings.with_program(code)
    write_run(run, list(scenes), asdict(Config(**asdict(settings))), configuration)
    plotly_file(run)
    tables = _Tables(run, recorded(run, scenes, configuration))
    done: dict[str, Record] = {}
    try:
        with _lease(run) as lease:
            template = Job("", "", str(run.resolve()), str(lease), settings, code, timeout_s, 0, settings.restarts)
            jobs = [replace(template, scene=name, source=str(path.resolve())) for name, path in scenes.items()]
            progress.begin(len(scenes), _threads(client), client.dashboard_link)
            client.register_plugin(Solvers())
            _check_shared(client, [lease, *list(scenes.values())[:1]])
            for arrived in _outcomes(client, jobs):
                if arrived is not None:
                    record, same = arrived
                    record = replace(record, files={})  # A hash of each file: memory must not grow with their number.
                    done[record.scene] = tables.records[record.scene] = record
                    progress.done(record, same)
                tables.write_when_due()
                progress.tick()
    except CannotWriteError as error:
        raise GtlayoutError(f"{error}; finished scenes are kept, and the same command goes on from there") from error
    except (CommClosedError, OSError, _LostError) as error:
        raise GtlayoutError(
            f"lost the Dask scheduler ({error}); finished scenes are kept, and the same command goes on from there"
        ) from error
    finally:
        with suppress(GtlayoutError):  # The earlier problem is the one to report.
            tables.write()
    return done


def _check_shared(client: Client, folders: Sequence[Path]) -> None:
    """Raises GtlayoutError when a worker does not see them."""
    for folder in folders:
        for worker, seen in client.run(os.path.isdir, str(folder.resolve()), on_error="return").items():
            if seen is not True:
                raise GtlayoutError(f"{worker} does not see {folder}: it needs scenes and results at the same paths")


class _LostError(Exception):
    """The scheduler no longer knows of a job."""


@dataclass
class _Tables:
    """run.csv and run.parquet, kept up to date."""

    run: Path
    records: dict[str, Record]
    due_s: float = field(default_factory=lambda: time.monotonic() + TABLES_EVERY_S)

    def write_when_due(self) -> None:
        """Write them, if they have not just been written. Raises GtlayoutError."""
        if time.monotonic() >= self.due_s:
            self.write()

    def write(self) -> None:
        """Write them. Raises GtlayoutError."""
        start_s = time.monotonic()
        write_tables(self.run, self.records.values())
        end_s = time.monotonic()
        self.due_s = end_s + max(TABLES_EVERY_S, (end_s - start_s) / TABLES_SHARE)


@contextmanager
def _lease(run: Path) -> Iterator[Path]:
    """A folder for work in progress. Those of earlier sessions are removed, so that these cannot finish their work."""
    run = run.resolve()
    lease = run / f"{LEASE}{uuid.uuid4().hex}"
    try:
        _discard(run, list(run.glob(f"{LEASE}*")))
        lease.mkdir()
    except OSError as error:
        raise GtlayoutError(f"cannot write {lease}: {error.strerror or error}") from error
    try:
        yield lease
    finally:
        with suppress(OSError):  # Another session may have taken over.
            _discard(run, [lease])


def _discard(run: Path, leases: Iterable[Path]) -> None:
    """Remove work in progress. Raises OSError."""
    for lease in leases:
        # Renamed as a whole first, so that no process that still works in it can put results, or half of them, into
        # place.
        lease.rename(run / f"{GONE}{uuid.uuid4().hex}")
    for gone in run.glob(f"{GONE}*"):
        shutil.rmtree(gone, ignore_errors=True)


def _outcomes(client: Client, jobs: Sequence[Job]) -> Iterator[tuple[Record, bool] | None]:
    """Record of each scene when it is done, and whether it was done before; None from time to time, while nothing
    arrives.

    Raises CannotWriteError, _LostError, or what the client raises when the scheduler is gone.
    """
    waiting = deque(jobs)
    pending: dict[object, tuple[Future[Outcome | None], Job]] = {}
    parts: dict[str, list[tuple[Job, Outcome | None]]] = {}
    arrived: SimpleQueue[Future[Outcome | None]] = SimpleQueue()
    threads, asked_s = _threads(client), time.monotonic()
    try:
        while waiting or pending:
            if time.monotonic() >= asked_s + LOOK_EVERY_S:  # A question to the scheduler: not after every scene.
                threads, asked_s = _threads(client), time.monotonic()
            while waiting and len(pending) < max(1, AHEAD * threads):
                job = waiting.popleft()
                parts[job.scene] = []
                for part in _split(job, threads // (len(waiting) + len(parts))):
                    future = client.submit(work_on, part, key=f"solve-{uuid.uuid4().hex}", retries=RETRIES)
                    pending[future.key] = future, part
                    future.add_done_callback(arrived.put)
            try:
                future, job = pending.pop(arrived.get(timeout=LOOK_EVERY_S).key)
            except Empty:
                if client.status != "running":
                    raise _LostError(f"the connection is {client.status}") from None
                yield None
                continue
            if future.status == "lost":  # its worker was, before the answer was fetched: another repeats it
                pending[future.key] = future, job
                future.add_done_callback(arrived.put)
                continue
            parts[job.scene].append((job, _outcome(future, job)))
            if sum(part.end_restart - part.first_restart for part, _ in parts[job.scene]) == job.settings.restarts:
                in_order = sorted(parts.pop(job.scene), key=lambda part: part[0].first_restart)
                yield _merged(job, [outcome for _, outcome in in_order if outcome is not None])
    finally:
        with suppress(Exception):  # There may be no scheduler left.
            client.cancel([future for future, _ in pending.values()], force=True)


def _threads(client: Client) -> int:
    return sum(client.nthreads().values())


def _split(job: Job, pieces: int) -> list[Job]:
    """The restarts of a scene for as many workers as have nothing else to do. Each part begins with the same tracking,
    so that with more scenes than workers it is better not to split.
    """
    pieces = max(1, min(pieces, job.settings.restarts))
    bounds = [job.settings.restarts * piece // pieces for piece in range(pieces + 1)]
    return [replace(job, first_restart=first, end_restart=end) for first, end in pairwise(bounds)]


def _outcome(future: Future[Outcome | None], job: Job) -> Outcome | None:
    if future.status == "cancelled":
        raise _LostError(f"it no longer knows of {job.scene}")
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, CannotWriteError):
        raise error
    lost = "its worker was lost, again and again" if isinstance(error, KilledWorker) else str(error) or repr(error)
    record = Record(job.scene, "failed", "worker", lost, source=job.source, configuration=job.configuration)
    if finished(scene_folder(Path(job.run), job.scene)):
        return Outcome(record)  # Existing results may still be good, and are kept.
    return Outcome(record, work=str(new_work_folder(Path(job.lease))))


def _merged(job: Job, outcomes: Sequence[Outcome]) -> tuple[Record, bool]:
    """The result of a scene, in its place: the restart with the best IoU, the first of equals."""
    failed = [outcome for outcome in outcomes if outcome.record.status == "failed"]
    best = failed[0] if failed else max(outcomes, key=lambda outcome: outcome.record.iou or 0.0)
    if best.work is None:
        return best.record, best.same
    records = [outcome.record for outcome in outcomes]
    stages = dict.fromkeys(stage for record in records for stage in record.stages_s)
    record = replace(
        best.record,
        seconds=sum(record.seconds or 0.0 for record in records) or None,
        stages_s={stage: sum(record.stages_s.get(stage, 0.0) for record in records) for stage in stages},
        peak_memory_mib=max(record.peak_memory_mib or 0.0 for record in records) or None,
        attempts=max(record.attempts for record in records),
    )
    return publish(record, Path(best.work), scene_folder(Path(job.run), job.scene)), False
