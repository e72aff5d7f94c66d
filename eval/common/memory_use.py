"""What the processes of a run take, while it runs."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType

import numpy as np
import psutil
from scipy.stats import theilslopes

from gtlayout.scene import FloatArray

EVERY_S = 1.0
MIB = 1 << 20


@dataclass(frozen=True)
class Use:
    """Resident memory at one moment, in MiB."""

    time_s: float
    """Since 1970."""
    client: float
    """The command itself; the scheduler of a local cluster is in it, too."""
    workers: float
    """All that it started, but solver processes."""
    solvers: float


class Watch:
    """Looks at a process and all that it starts once a second: ``with Watch(pid) as watch: …``, then ``watch.seen``."""

    def __init__(self, pid: int) -> None:
        self.seen: list[Use] = []
        self._process = psutil.Process(pid)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def __enter__(self) -> Watch:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, value: object, trace: TracebackType | None) -> None:
        self._over.set()
        self._thread.join()

    def _look(self) -> None:
        while not self._over.wait(EVERY_S):
            with suppress(psutil.Error):
                self.seen.append(use_of(self._process))


def use_of(client: psutil.Process) -> Use:
    """What it takes now. Raises psutil.NoSuchProcess when it is gone."""
    workers = solvers = 0
    own = client.memory_info().rss
    for process in client.children(recursive=True):
        with suppress(psutil.Error):
            resident, command = process.memory_info().rss, " ".join(process.cmdline())
            if "gtlayout.batch.solver" in command:
                solvers += resident
            else:
                workers += resident
    return Use(time.time(), own / MIB, workers / MIB, solvers / MIB)


def slope_kib(done: Sequence[float] | FloatArray, mib: Sequence[float] | FloatArray) -> float:
    """KiB a scene, from the second tenth of them on: the median of all slopes between two looks; NaN without two.

    What is loaded once, whatever the number of scenes, is loaded in the first tenth. The median passes over the few
    scenes that are broken so that they eat memory.
    """
    x, y = np.asarray(done, dtype=np.float64), np.asarray(mib, dtype=np.float64) * 1024
    later = x >= 0.1 * x.max(initial=0.0)
    if len(np.unique(x[later])) < 2:
        return float("nan")
    return float(theilslopes(y[later], x[later]).slope)
