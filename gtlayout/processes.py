"""Work in several processes of one thread each. Quick to import."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TypeVar

from gtlayout.errors import GtlayoutError
from gtlayout.signals import keep_sigterm

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Died:
    """In place of a result: the process that worked on the item has ended."""

    exit_status: int | None
    """Negative: the signal that killed it."""


def outcomes(
    work: Callable[[Item], Result], items: Sequence[Item], processes: int
) -> Generator[tuple[int, Result | Died]]:
    """Call ``work`` with each item in one of so many processes; (number of the item, result) as they come.

    A process that dies costs the item that it worked on, and is replaced. Every process has a pipe of its own: a queue
    that they share is locked for ever when one dies that reads it, as that of ``ProcessPoolExecutor`` once was.

    When the caller goes on no more, all processes stop: in each ``work`` ends with SystemExit.

    Args:
        work: a function that can be pickled, as can the items and the results. What it raises ends its process.
        items: worked on in this order, though not one after another.
        processes: at least 1.
    """
    waiting = iter(enumerate(items))
    running: dict[Connection, BaseProcess] = {}
    at_work: dict[Connection, int] = {}

    def begin(idle: Connection | None = None) -> None:
        for number, item in islice(waiting, 1):
            here = idle
            if here is None:
                here, running[here] = _started(work)
            at_work[here] = number
            with suppress(OSError):  # A process that is gone is noticed when its answer is waited for.
                here.send(item)

    try:
        for _ in range(processes):
            begin()
        while at_work:
            ready = wait(list(at_work))
            for here in [one for one in at_work if one in ready]:
                number = at_work.pop(here)
                try:
                    result: Result = here.recv()
                except (EOFError, OSError):
                    process = running.pop(here)
                    process.join()
                    yield number, Died(process.exitcode)
                    begin()
                else:
                    yield number, result
                    begin(here)
    finally:
        for process in running.values():
            process.terminate()
        for process in running.values():
            process.join()


def in_processes(
    work: Callable[[Item], object], items: Sequence[Item], processes: int, progress: Callable[[int, int], None]
) -> None:
    """Call ``work`` with each item in one of so many processes; ``progress`` is called with (items done, items in all).

    An exception, Ctrl-C too, stops all processes: in each ``work`` ends with SystemExit.

    Args:
        work: a function that can be pickled, as can the items.
        items: worked on in this order, though not one after another.
        processes: at least 1.
        progress: called in this process.

    Raises:
        GtlayoutError: ``work`` raised it, or a process was killed.
        RuntimeError: ``work`` raised something else; its traceback is on stderr.
    """
    progress(0, len(items))
    with closing(outcomes(partial(_problem_of, work), items, processes)) as found:
        for done, (_, problem) in enumerate(found, start=1):
            if isinstance(problem, Died):
                raise _ended(problem.exit_status)
            if problem is not None:
                raise GtlayoutError(problem)
            progress(done, len(items))


def _problem_of(work: Callable[[Item], object], item: Item) -> str | None:
    try:
        work(item)
    except GtlayoutError as error:
        return str(error)
    return None


def _started(work: Callable[[Item], Result]) -> tuple[Connection, BaseProcess]:
    # Spawned, because OpenCV's threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there, work), daemon=True)
    with single_threaded():
        process.start()
    there.close()
    return here, process


def _serve(there: Connection, work: Callable[[Item], Result]) -> None:
    """Work on one item after another until no more are sent."""
    # Ctrl-C in a terminal reaches all processes: the one that was started by the user decides what comes of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    keep_sigterm()
    import cv2

    cv2.setNumThreads(1)
    while True:
        try:
            item = there.recv()
        except (EOFError, OSError):
            return
        result = work(item)
        with suppress(OSError):
            there.send(result)


def _ended(exit_status: int | None) -> Exception:
    if exit_status is not None and exit_status < 0:
        name = signal.Signals(-exit_status).name
        return GtlayoutError(f"a process was killed ({name}; out of memory?): run the same command again to go on")
    return RuntimeError("a process ended: see what it wrote above")


ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1")
"""Environment of a process whose libraries use one thread. OpenCV is set in the process."""


@contextmanager
def single_threaded() -> Iterator[None]:
    """Processes that are started within use one thread."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
