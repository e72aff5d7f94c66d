"""A Dask scheduler and workers on this machine, each a process of its own, as one starts them by hand."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil
from distributed import Client

START_S = 60.0
END_S = 15.0
"""What nobody waits for any more is given this long to notice and to end."""


class DaskProcesses:
    """Started by ``restore``, whenever one of them is gone; all are ended by ``close``."""

    def __init__(self, folder: Path, workers: int, environment: Mapping[str, str]) -> None:
        """``folder`` takes their logs and scratch files."""
        folder.mkdir(parents=True, exist_ok=True)
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        self._folder, self._environment = folder, dict(environment)
        self._commands = {"scheduler": ["dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]}
        for number in range(workers):
            name = f"worker-{number}"
            threads = ["--nthreads", "1", "--memory-limit", "1.5GiB", "--local-directory", str(folder)]
            self._commands[name] = ["dask_worker", self.address, "--name", name, "--no-dashboard", *threads]
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    @property
    def workers(self) -> list[str]:
        """Names."""
        return [name for name in self._commands if name != "scheduler"]

    def restore(self) -> None:
        """Start what does not run, and wait until the scheduler knows all workers. Raises TimeoutError."""
        until = time.monotonic() + START_S
        known: set[str] = set()
        while not known.issuperset(self.workers):
            if time.monotonic() > until:
                raise TimeoutError(f"the Dask processes do not come up: see {self._folder}")
            for name, command in self._commands.items():
                if name not in self._running or self._running[name].poll() is not None:
                    self._start(name, command)
            time.sleep(0.2)
            with suppress(OSError, TimeoutError), self._client() as client:
                known = {str(worker["name"]) for worker in client.scheduler_info(n_workers=-1)["workers"].values()}

    def nanny(self, name: str) -> psutil.Process:
        """The process that was started, which starts and guards the worker itself."""
        return psutil.Process(self._running[name].pid)

    def worker(self, name: str) -> psutil.Process:
        """The worker itself, once its nanny has started it. Raises TimeoutError."""
        until = time.monotonic() + START_S
        while time.monotonic() < until:
            for child in self.nanny(name).children():
                with suppress(psutil.Error):
                    if "spawn_main" in " ".join(child.cmdline()):
                        return child
            time.sleep(0.1)
        raise TimeoutError(f"{name} does not come up: see {self._folder}")

    def close(self) -> None:
        """End all of them, and what they started."""
        processes = [psutil.Process(one.pid) for one in self._running.values() if one.poll() is None]
        kill([*processes, *(child for one in processes for child in one.children(recursive=True))])
        for one in self._running.values():
            one.wait()

    def _start(self, name: str, command: list[str]) -> None:
        module, *arguments = command
        with (self._folder / f"{name}.log").open("ab") as log:
            self._running[name] = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{module}", *arguments],
                env=self._environment,
                stdout=log,
                stderr=log,
            )

    def _client(self) -> Any:
        return Client(self.address, timeout=2, set_as_default=False)


@contextmanager
def dask_processes(folder: Path, workers: int, environment: Mapping[str, str]) -> Iterator[DaskProcesses]:
    """A scheduler and ``workers`` of one thread, ready; all are gone afterwards."""
    processes = DaskProcesses(folder, workers, environment)
    try:
        processes.restore()
        yield processes
    finally:
        processes.close()


def kill(processes: list[psutil.Process]) -> None:
    """With SIGKILL; those that are gone already are passed over."""
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            process.kill()


def left_behind(name: str, value: str, *, orphans_only: bool = False) -> list[int]:
    """Processes with this variable in their environment that never end by themselves, or those whose parent is gone."""
    until = time.monotonic() + END_S
    while True:
        ours = {process.pid: process for process in marked(name, value)}
        parents = {*ours, os.getpid()} if orphans_only else set()
        left = [pid for pid, process in ours.items() if process.ppid() not in parents]
        if not left or time.monotonic() > until:
            return left
        time.sleep(0.2)


def marked(name: str, value: str) -> list[psutil.Process]:
    """All processes with this variable in their environment: those that were started with it, and theirs."""
    found = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if process.status() != psutil.STATUS_ZOMBIE and process.environ().get(name) == value:
                found.append(process)
    return found
