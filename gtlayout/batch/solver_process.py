"""Controls a solver process: starts, asks and watches it, and stops it when it hangs or grows too large."""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import IO

import psutil

from gtlayout.batch.job import BEGUN, Answer, Attempt, Job
from gtlayout.batch.record import SOLVE_LOG_FILE
from gtlayout.batch.results import lease_lost
from gtlayout.errors import GtlayoutError
from gtlayout.processes import ONE_THREAD

LOOK_EVERY_S = 0.1
"""Between two looks at a process's memory."""
LEASE_EVERY_S = 2.0
"""Between two looks at whether its result is still wanted."""
START_S = 600.0
"""For its imports: a thousand processes may read them from one network disk at once."""
GRACE_S = 5.0
"""Time for a process whose time is up to write a traceback and end by itself."""
LOG_SAYS = f"where it was stands in {SOLVE_LOG_FILE}"
BEGUN_LINE = json.dumps(BEGUN) + "\n"
ENDED = ""
"""In the place of a line."""


class SolverProcess:
    """One ``gtlayout.batch.solver``, started when it is first needed and again after it was stopped or died."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._lines: SimpleQueue[str] = SimpleQueue()
        self._program = ""

    def solve(self, attempt: Attempt, memory_bytes: Callable[[], float]) -> tuple[Answer, float]:
        """Have a scene solved. The answer also reports a process that hung, crashed or took more than
        ``memory_bytes()``.

        Returns the answer and the largest resident set seen, bytes.

        Raises:
            GtlayoutError: no process can be started, or it runs other code than the job was made for.
            LeaseLostError: the job's lease is gone.
        """
        job = attempt.job
        self._check_lease(job)  # This may be the second attempt of a run that was stopped.
        process = self._started(job.program)
        _say(process, json.dumps(asdict(attempt)))
        resident = psutil.Process(process.pid)
        start_s = lease_seen_s = time.monotonic()
        peak_bytes = 0
        begun = False
        while (line := self._line(LOOK_EVERY_S)) is None or line == BEGUN_LINE:
            begun = begun or line is not None
            now_s = time.monotonic()
            peak_bytes = max(peak_bytes, taken := _resident_bytes(resident))
            if taken > (allowed := memory_bytes()):
                self.close()
                reason = f"took {taken / 2**30:.2f} GiB of memory and may take {allowed / 2**30:.2f}"
                return Answer(failure="memory", reason=reason, begun=begun), peak_bytes
            if now_s - start_s > job.timeout_s + GRACE_S:
                # It should have ended by itself. One that waits for a dead disk may not even end now.
                self.close()
                return _late(job, begun), peak_bytes
            if now_s - lease_seen_s > LEASE_EVERY_S:
                lease_seen_s = now_s
                self._check_lease(job)
        if line != ENDED:
            return Answer(**json.loads(line)), max(peak_bytes, _resident_bytes(resident))
        late = time.monotonic() - start_s >= job.timeout_s
        status = process.wait()
        self.close()
        if late:
            return _late(job, begun), peak_bytes
        return Answer(failure="died", reason=f"its process {_ended(status)}; {LOG_SAYS}", begun=begun), peak_bytes

    def close(self) -> None:
        """Stop the process, whatever it does."""
        # Two threads may do so at once: the one that uses it, and the one that ends the worker.
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            with suppress(subprocess.TimeoutExpired):
                process.wait(GRACE_S)

    def _started(self, program: str) -> subprocess.Popen[str]:
        if self._process is None or self._process.poll() is not None or self._program != program:
            self.close()  # an update since it was started, perhaps
            self._lines = SimpleQueue()
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "gtlayout.batch.solver"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                encoding="utf-8",
                env=os.environ | ONE_THREAD,
                start_new_session=True,  # Ctrl-C at the terminal is for the client: it ends the others in order.
            )
            threading.Thread(target=_read, args=(self._process.stdout, self._lines), daemon=True).start()
            first = self._line(START_S)
            if not first:
                self.close()
                raise GtlayoutError(f"no solver process can be started on {platform.node()}; the worker's log says why")
            self._program = json.loads(first)["program"]
        if self._program != program:
            raise GtlayoutError(f"{platform.node()} has gtlayout {self._program}, the run was started with {program}")
        return self._process

    def _check_lease(self, job: Job) -> None:
        if not Path(job.lease).is_dir():
            self.close()
            raise lease_lost(Path(job.lease))

    def _line(self, timeout_s: float) -> str | None:
        try:
            return self._lines.get(timeout=timeout_s)
        except Empty:
            return None


def _late(job: Job, begun: bool) -> Answer:
    return Answer(failure="timeout", reason=f"not done in {job.timeout_s:g} s; {LOG_SAYS}", begun=begun)


def _read(pipe: IO[str], lines: SimpleQueue[str]) -> None:
    with pipe:
        for line in pipe:
            lines.put(line)
    lines.put(ENDED)


def _say(process: subprocess.Popen[str], line: str) -> None:
    assert process.stdin is not None
    with suppress(OSError):  # It died just now, which shows when it is listened to.
        print(line, file=process.stdin, flush=True)


def _resident_bytes(process: psutil.Process) -> int:
    try:
        return int(process.memory_info().rss)
    except psutil.Error:
        return 0


def _ended(status: int) -> str:
    if status >= 0:
        return f"ended with status {status}"
    try:
        name = signal.Signals(-status).name
    except ValueError:
        name = f"signal {-status}"
    hint = ": the machine may have run out of memory" if name == "SIGKILL" else ""
    return f"died of {name}{hint}"
