"""Work in several processes of one thread each. Quick to import."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TypeVar

from gtlayout.errors import GtlayoutError

Item = TypeVar("Item")


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
    # Spawned, because OpenCV's threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    waiting, done = iter(items), 0
    running: dict[Connection, BaseProcess] = {}
    at_work: set[Connection] = set()
    progress(0, len(items))
    try:
        with single_threaded():
            for item in islice(waiting, processes):
                here, there = context.Pipe()
                running[here] = context.Process(target=_serve, args=(there, work), daemon=True)
                running[here].start()
                there.close()
                at_work.add(_sent(item, here))
        while at_work:
            for here in at_work.intersection(wait(at_work)):
                at_work.remove(here)
                try:
                    problem = here.recv()
                except (EOFError, OSError):
                    running[here].join()
                    raise _ended(running[here].exitcode) from None
                if problem is not None:
                    raise GtlayoutError(problem)
                done += 1
                progress(done, len(items))
                for item in islice(waiting, 1):
                    at_work.add(_sent(item, here))
    finally:
        for process in running.values():
            process.terminate()
        for process in running.values():
            process.join()


def _sent(item: object, here: Connection) -> Connection:
    # A process that is gone is noticed when its answer is waited for.
    with suppress(OSError):
        here.send(item)
    return here


def _serve(there: Connection, work: Callable[[Item], object]) -> None:
    """Work on one item after another until no more are sent."""
    # Ctrl-C in a terminal reaches all processes: the one that was started by the user decides what comes of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    import cv2

    cv2.setNumThreads(1)
    while True:
        try:
            item = there.recv()
        except (EOFError, OSError):
            return
        problem = None
        try:
            work(item)
        except GtlayoutError as error:
            problem = str(error)
        with suppress(OSError):
            there.send(problem)


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
