"""A command is run again and again, is killed, and what it leaves is compared with what undisturbed runs write."""

from __future__ import annotations

import multiprocessing
import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.context import ForkProcess
from pathlib import Path

from gtlayout.errors import GtlayoutError
from gtlayout.signals import end_in_one_line, ending, nothing_left_to_end

HANGS_S = 600.0
FORK = multiprocessing.get_context("fork")
"""All is imported once, in the process that forks; it computes nothing, so that it has no threads."""
State = dict[str, bytes]
"""Path of a file → what it holds."""
OTHER = {"a": "b", "b": "a"}


@dataclass(frozen=True)
class Command:
    """What is killed. Its variants a and b write the same files with other contents, so that a mixture is seen."""

    run: Callable[[str, Path], int]
    """Of a variant and the folder that it writes to; its exit status. In a process of its own."""
    varying: frozenset[str] = frozenset()
    """Files that hold times."""
    last: str = ""
    """Of several files: where it is not, they are not said to belong together."""
    anew: bool = False
    """It makes what was not there, and both variants make the same."""


@dataclass
class Found:
    """Of one command."""

    runs: int = 0
    """That were killed, or pairs that wrote at once."""
    writing: int = 0
    """Of these, killed after they had begun to write."""
    new: int = 0
    """Of these, killed when all new files had their places already."""
    incomplete: int = 0
    """Of these, killed while several files took their places: the last one is not there, which says so."""
    remains: int = 0
    """Temporary files and folders that kills left, until the next run."""
    wrong: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Started:
    """A process that runs a command, and the end of a pipe in which it says that it begins to write."""

    process: ForkProcess
    writes: int

    def wait_for_writing(self) -> None:
        """Until it writes, or ends."""
        os.read(self.writes, 1)

    def end(self) -> int:
        """Its exit status, negative for a signal. Raises GtlayoutError when it hangs."""
        self.process.join(HANGS_S)
        os.close(self.writes)
        status = self.process.exitcode
        if status is None:
            self.process.kill()
            raise GtlayoutError("the command hangs")
        return status


def alone(work: Callable[[], int], log: Path) -> None:
    """Do it in a process of its own. Raises GtlayoutError when its exit status is not 0."""
    log.parent.mkdir(parents=True, exist_ok=True)
    if start(work, log.parent, log).end():
        raise GtlayoutError(f"that failed: see {log}")


def start(work: Callable[[], int], folder: Path, log: Path) -> Started:
    """In a process that answers signals as the command line does. It says when it begins to write into ``folder``."""
    read, write = os.pipe()
    process = FORK.Process(target=_child, args=(work, folder, log, read, write))
    process.start()
    os.close(write)
    return Started(process, read)


def _child(work: Callable[[], int], folder: Path, log: Path, read: int, write: int) -> None:
    end_in_one_line("gtlayout")
    os.close(read)
    with log.open("ab") as printed:
        os.dup2(printed.fileno(), 1)
        os.dup2(printed.fileno(), 2)
    inside = f"{folder}{os.sep}"
    told = False

    def watch(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal told
        if event == "open" and not told and str(arguments[0]).startswith(inside):
            flags = arguments[2]
            told = isinstance(flags, int) and bool(flags & os.O_CREAT)
            if told:
                os.write(write, b"w")

    sys.addaudithook(watch)
    try:
        status = work()
    except KeyboardInterrupt as error:
        status = ending(error)[1]
    nothing_left_to_end()
    sys.exit(status)


class Bench:
    """Where one command is killed."""

    def __init__(self, command: Command, folder: Path, rng: random.Random) -> None:
        """Runs both variants undisturbed, to know what they write. Raises GtlayoutError when they fail."""
        self._command, self._rng = command, rng
        self._log, self._to = folder / "log.txt", folder / "work"
        self._to.mkdir(parents=True)
        self._whole: dict[str, State] = {}
        for variant in ("b", "a"):
            began = time.monotonic()
            started = self._start(variant)
            started.wait_for_writing()
            writes = time.monotonic()
            if started.end():
                raise GtlayoutError(f"the command fails: see {self._log}")
            self._runs_s, self._writes_s = time.monotonic() - began, time.monotonic() - writes
            self._whole[variant] = self._state()
            self._clear()
        if not command.anew and self._whole["a"] == self._whole["b"]:
            raise GtlayoutError("the variants are the same: no mixture would be seen")
        self._in_place = "a"

    def kill(self, count: int, number: signal.Signals) -> Found:
        """So many kills by this signal."""
        found = Found()
        while found.runs < count and len(found.wrong) < 10:
            begun = self._start(OTHER[self._in_place])
            writing = bool(found.runs % 2)
            if writing:
                begun.wait_for_writing()
                time.sleep(self._rng.random() ** 2 * self._writes_s)
            else:
                begun.process.join(self._rng.uniform(0, self._runs_s))
            if begun.process.is_alive():
                os.kill(begun.process.pid or 0, number)
            status = begun.end()
            if status not in (0, -signal.SIGKILL, 128 + signal.SIGTERM, -signal.SIGTERM):
                found.wrong.append(f"kill {found.runs}: exit status {status}")
            if status:  # else it was done already
                found.runs += 1
                found.writing += writing
            new = self._look(found, OTHER[self._in_place], by_hand=number == signal.SIGTERM)
            found.new += bool(status and new)
            if status and (found.runs % 10 == 0 or found.runs == count):
                self._next_run(found)
            self._clear()
        return found

    def pairs(self, count: int) -> Found:
        """So many times two that begin at almost the same time: one of them wins, whole."""
        found = Found()
        for _ in range(count):
            both = [self._start(variant) for variant in "ab"]
            statuses = sorted(one.end() for one in both)
            found.runs += 1
            if statuses != [0, int(self._command.anew)]:
                found.wrong.append(f"pair {found.runs}: exit statuses {statuses}")
            self._look(found, "a", by_hand=True)
            self._clear()
        return found

    def _start(self, variant: str) -> Started:
        return start(lambda: self._command.run(variant, self._to), self._to, self._log)

    def _look(self, found: Found, variant: str, *, by_hand: bool) -> bool:
        """Whether all is new that is there after a kill. Whoever could tidy up ``by_hand`` leaves nothing."""
        state, left = self._state(), self._left()
        found.remains += len(left)
        found.wrong += [f"run {found.runs}: {name} is left" for name in left if by_hand]
        if state == self._whole[variant]:
            self._in_place = variant
            return True
        old: State = {} if self._command.anew else self._whole[OTHER[variant]]
        each_whole = all(content in (old.get(name), self._whole[variant].get(name)) for name, content in state.items())
        if self._command.last and self._command.last not in state and each_whole:
            found.incomplete += 1
        elif state != old:
            differ = sorted(name for name in self._whole[variant] if state.get(name) != self._whole[variant][name])
            found.wrong.append(f"run {found.runs}: neither old nor new: of {len(state)} files {', '.join(differ)}")
        return False

    def _next_run(self, found: Found) -> None:
        self._in_place = OTHER[self._in_place]
        if self._command.anew and self._state():
            shutil.rmtree(next(path for path in self._to.iterdir() if not path.name.startswith(".")))
        status = self._start(self._in_place).end()
        if status or self._state() != self._whole[self._in_place]:
            found.wrong.append(f"run {found.runs}: the next run did not work: exit status {status}")
        found.wrong += [f"run {found.runs}: {name} is left for ever" for name in self._left()]

    def _state(self) -> State:
        paths = [path for path in sorted(self._to.rglob("*")) if path.is_file()]
        names = {path: path.relative_to(self._to) for path in paths}
        return {
            str(name): b"" if name.name in self._command.varying else path.read_bytes()
            for path, name in names.items()
            if not any(part.startswith(".") for part in name.parts)
        }

    def _left(self) -> list[str]:
        return sorted(path.name for path in self._to.iterdir() if path.name.startswith("."))

    def _clear(self) -> None:
        """What was made goes, hidden remains do not, where the command makes something new."""
        for path in self._to.iterdir() if self._command.anew else ():
            if not path.name.startswith("."):
                shutil.rmtree(path)
