"""The progress of a run: a bar on a terminal, a line from time to time elsewhere."""

from __future__ import annotations

import time
from collections import Counter
from datetime import timedelta
from types import TracebackType
from typing import get_args

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from gtlayout.batch.record import Record
from gtlayout.io.files import printable
from gtlayout.quality.headline import Word

LINE_EVERY_S = 30.0
"""Without a terminal."""


class RunProgress:
    """Counts scenes and prints the counts on stderr."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
        columns = (BarColumn(bar_width=20), TextColumn("{task.description}", markup=False))
        terminal = self._console.is_terminal
        self._bars = Progress(*columns, console=self._console, disable=not terminal, refresh_per_second=2)
        self._bar: TaskID | None = None
        self._total = self._solved = 0
        self._counts: Counter[Word | None] = Counter()
        self._start_s = self._said_s = time.monotonic()

    def __enter__(self) -> RunProgress:
        self._bars.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._bars.stop()

    def begin(self, scenes: int, threads: int, dashboard: str) -> None:
        """Begin with this many scenes, this many at a time."""
        self._total, self._start_s = scenes, time.monotonic()
        at_a_time = f"{threads} at a time" if threads else "waiting for workers"
        self._console.print(f"{scenes} scene{'s' if scenes > 1 else ''}, {at_a_time}; Dask's dashboard: {dashboard}")
        self._bar = self._bars.add_task(self.line(), total=scenes)

    def done(self, record: Record, same: bool) -> None:
        """Count a scene that is done. ``same``: its earlier results are still good."""
        self._counts[record.headline] += 1
        self._solved += not same
        if record.status == "failed" and not same:
            self._console.print(f"{printable(record.scene)} failed ({record.failure}): {record.reason}")

    def tick(self) -> None:
        """Print the progress, if it is time to."""
        if self._bar is not None:
            self._bars.update(self._bar, completed=self._counts.total(), description=self.line())
        if self._bars.disable and time.monotonic() - self._said_s >= LINE_EVERY_S:
            self._said_s = time.monotonic()
            self._console.print(self.line())

    def line(self) -> str:
        """Scenes done, how many of each verdict, failed, rate and time left."""
        done, elapsed_s = self._counts.total(), time.monotonic() - self._start_s
        parts = [
            f"{done}/{self._total} done",
            *(f"{self._counts[word]} {word}" for word in get_args(Word)),
            f"{self._counts[None]} failed",
        ]
        if done > self._solved:
            parts.append(f"{done - self._solved} as before")
        if self._solved:
            rate = self._solved / elapsed_s
            left = timedelta(seconds=round((self._total - done) / rate))
            parts += [f"{60 * rate:.3g} a minute", f"{left} left"]
        return ", ".join(parts)
