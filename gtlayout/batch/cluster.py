"""Where scenes are solved: on a Dask cluster of this machine's cores, or on an existing one."""

from __future__ import annotations

import logging
import signal
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import dask
from dask.system import CPU_COUNT
from dask.utils import parse_bytes
from distributed import Client, LocalCluster, Worker
from distributed.diagnostics.plugin import WorkerPlugin
from distributed.system import MEMORY_LIMIT
from distributed.utils import silence_logging_cmgr

from gtlayout.batch.fingerprint import program
from gtlayout.errors import GtlayoutError
from gtlayout.processes import ONE_THREAD

WORKER_BYTES = 3 << 29
"""1.5 GiB for each worker: a film of 2,000 frames in full HD takes 0.6, a worker itself 0.15."""
MEMORY_SHARE = 0.9
"""Of the machine's memory, for all workers."""
CONNECT_S = 30
SETTINGS = {
    # Profiles of the workers' stacks a hundred times a second. The work is done in other processes.
    "distributed.worker.profile.enabled": False,
    # Dask's records of each task, for its developers and its dashboard. Memory must not grow with the number of scenes.
    "distributed.admin.low-level-log-length": 100,
    "distributed.admin.system-monitor.log-length": 600,
    "distributed.scheduler.dashboard.tasks.task-stream-length": 1000,
}
LOOPBACK = "127.0.0.1"
DASHBOARD_PORT = 8787
"""Dask's own; another one is taken when it is in use."""


@contextmanager
def local_cluster(workers: int | None = None, memory_limit: str | None = None) -> Iterator[Client]:
    """Worker processes on this machine, of one thread each, that only this machine can reach.

    ``workers``: as many as there are cores and memory for when not given. ``memory_limit`` of each, with the scene it
    solves, as "4GiB"; an equal share of nine tenths of the memory when not given. Raises GtlayoutError when it is not
    a size.
    """
    number = workers or max(1, min(CPU_COUNT, int(MEMORY_SHARE * MEMORY_LIMIT) // WORKER_BYTES))
    limit_bytes = _bytes(memory_limit) if memory_limit else int(MEMORY_SHARE * MEMORY_LIMIT) // number
    with dask.config.set(SETTINGS):
        with warnings.catch_warnings(action="ignore"):  # that the dashboard's port is in use: the other one is printed
            cluster = LocalCluster(
                n_workers=number,
                threads_per_worker=1,
                processes=True,
                memory_limit=limit_bytes,
                host=LOOPBACK,
                dashboard_address=f"{LOOPBACK}:{DASHBOARD_PORT}",
                silence_logs=logging.CRITICAL,
                env=ONE_THREAD,
            )
        with cluster, Client(cluster, set_as_default=False) as client:
            client.register_plugin(_IgnoreInterrupt())
            yield client


class _IgnoreInterrupt(WorkerPlugin):
    """Ctrl-C at the terminal reaches workers, too; it is for the client, which then ends them."""

    name = "gtlayout-ignore-interrupt"

    def setup(self, worker: Worker) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def existing_cluster(address: str) -> Iterator[Client]:
    """The cluster whose scheduler listens at ``address``, as "tcp://host:8786".

    Raises GtlayoutError when none answers, or a worker has no gtlayout or a different one.
    """
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:  # the last: tls:// without certificates
        raise GtlayoutError(f"no Dask scheduler answers at {address}: {error}") from error
    # Problems of the connection are reported in one line. Dask would log a traceback.
    with silence_logging_cmgr(logging.CRITICAL), client:
        here = program()
        for worker, there in client.run(program, on_error="return").items():
            if there != here:
                raise GtlayoutError(f"{worker} has gtlayout {there}, here is {here}: install the same everywhere")
        yield client


def _bytes(size: str) -> int:
    try:
        number = int(parse_bytes(size))
    except ValueError:
        number = 0
    if number <= 0:
        raise GtlayoutError(f"{size!r} is no size of memory; write it as 4GiB")
    return number
