"""Runs cases, and says what of their promises does not hold."""

from __future__ import annotations

import hashlib
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from faulty.case import HERE, SCENE, Case
from gtlayout.api import load_solved
from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError

COMMAND = (sys.executable, "-P", "-m", "gtlayout")
NOBODY = 65534
"""Who owns nothing."""
FILE_BYTES = 2048
"""The longest file of ``small files``."""
DISK_KB = 64
"""The size of a ``full disk``."""
CRASH = 70
"""Status of what ends in a traceback."""
Digests = dict[str, str]


class CannotRunError(Exception):
    """The machine does not let a case be made; says why."""


@dataclass(frozen=True)
class Seen:
    """What a user has of a run."""

    status: int
    out: str
    err: str

    @property
    def text(self) -> str:
        """Both streams."""
        return self.out + self.err


@dataclass(frozen=True)
class Judged:
    """A case that was run."""

    seen: Seen
    broken: tuple[str, ...]
    """Promises that do not hold, in words."""


def judge(case: Case, room: Path, here: Path) -> Judged:
    """Run ``case`` on a copy of ``room`` in the folder ``here``, which is new and the case's own.

    Raises CannotRunError when the machine does not let it be made.
    """
    if case.way != "nobody":
        return _judge(case, room, here)
    # pytest lets nobody else into its folders.
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o711)
        return _judge(case, room, Path(folder) / "here")


def _judge(case: Case, room: Path, here: Path) -> Judged:
    here.mkdir()
    scene = Path(shutil.copytree(room, here / "scene"))
    case.spoil(scene)
    before = digests(here)
    seen = _WAYS[case.way](case, scene, here)
    return Judged(seen, tuple(_broken(case, seen, before, here)))


def arguments(case: Case, scene: Path) -> list[str]:
    """The command with the folders' paths."""
    return [word.replace(SCENE, str(scene)).replace(HERE, str(scene.parent)) for word in case.command]


def digests(folder: Path) -> Digests:
    """Path within ``folder`` → what is there; links are not followed."""
    return {
        str(path.relative_to(folder)): "folder" if path.is_dir() else hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_dir() or path.is_file()
    }


def _broken(case: Case, seen: Seen, before: Digests, here: Path) -> Iterator[str]:
    """Each promise that does not hold."""
    if seen.status != case.status:
        yield f"exit status {seen.status}, not {case.status}"
    if "Traceback" in seen.text or seen.status < 0 or seen.status == CRASH:
        yield "a traceback"
    at = 0
    for words in case.says:
        found = seen.text.find(words, at)
        if found < 0:
            yield f"{words!r} is not said"
        at = max(at, found)
    yield from (f"{words!r} is said" for words in case.silent if words in seen.text)
    if case.status in (1, 2) and not re.fullmatch(r"gtlayout: [^\n]+\n", seen.err):
        yield f"not one line on standard error, but {seen.err.count(chr(10))}"
    if case.status in (0, 3) and seen.err:
        yield "lines on standard error"
    if re.search(r"\bnan\b|\binf\b", seen.out) and "NaN" not in case.fault:
        yield "nan or inf is printed"
    after = digests(here)
    yield from (f"{name} was changed" for name, was in before.items() if after.get(name) != was)
    new = sorted(after.keys() - before.keys())
    yield from (f"{name} was left over" for name in new if name.endswith(".tmp") or "/." in name)
    if case.status == 0 and case.command[0] == "solve":
        yield from _unreadable(here)
    elif new and not (
        ("import" in case.command and case.way == "two")
        or (case.status == 0 and case.command[0] in ("import", "export", "report"))
    ):
        yield f"{', '.join(new)} was written"


def _unreadable(here: Path) -> Iterator[str]:
    """What is wrong with results that were written."""
    results = here / "out" if (here / "out").exists() else None
    try:
        load_solved(here / "scene", results)
    except GtlayoutError as error:
        yield f"the results cannot be read: {error}"


@contextmanager
def _captured(streams: dict[int, Path]) -> Iterator[None]:
    """What anything in this process writes to standard output and error goes to files, C included."""
    kept = {number: os.dup(number) for number in streams}
    sys.stdout.flush()
    sys.stderr.flush()
    try:
        for number, path in streams.items():
            with path.open("wb") as file:
                os.dup2(file.fileno(), number)
        with (
            open(1, "w", encoding="utf-8", closefd=False) as out,
            open(2, "w", encoding="utf-8", closefd=False) as err,
            redirect_stdout(out),
            redirect_stderr(err),
        ):
            yield
    finally:
        for number, copy in kept.items():
            os.dup2(copy, number)
            os.close(copy)


def _here(case: Case, scene: Path, _here: Path) -> Seen:
    """In this process."""
    with tempfile.TemporaryDirectory() as folder:
        streams = {1: Path(folder) / "out", 2: Path(folder) / "err"}
        with _captured(streams):
            try:
                status = main(arguments(case, scene))
            except Exception:
                traceback.print_exc()
                status = CRASH
        out, err = (path.read_text(encoding="utf-8", errors="replace") for path in streams.values())
    return Seen(status, out, err)


def _process(case: Case, scene: Path, _here: Path) -> Seen:
    """In a process of its own."""
    return _ended(_started(_words(case, scene)))


def _nobody(case: Case, scene: Path, _here: Path) -> Seen:
    """As a user who owns nothing here, which only root can become, with modules that were loaded before."""
    if os.geteuid() != 0:
        raise CannotRunError("only root can become another user")
    with tempfile.TemporaryDirectory() as other:
        warm = shutil.copytree(scene, Path(other) / "scene")
        program = _AS_NOBODY.format(warm=arguments(case, warm), real=arguments(case, scene), user=NOBODY)
        return _ended(_started([sys.executable, "-P", "-c", program]))


def _small_files(case: Case, scene: Path, _here: Path) -> Seen:
    """Where no file may be longer than ``FILE_BYTES``, as under a quota."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_BYTES, FILE_BYTES))

    return _ended(_started(_words(case, scene), limit))


def _full_disk(case: Case, scene: Path, here: Path) -> Seen:
    """``HERE/disk`` is a disk of ``DISK_KB``."""
    disk = here / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={DISK_KB}k", "tmpfs", str(disk)], capture_output=True, check=False
    )
    if mounted.returncode:
        disk.rmdir()
        raise CannotRunError("no disk can be mounted")
    try:
        seen = _ended(_started(_words(case, scene)))
        left = digests(disk)
    finally:
        subprocess.run(["umount", str(disk)], check=True)
        disk.rmdir()
    return Seen(seen.status, seen.out, seen.err + "".join(f"{name} is left on the disk\n" for name in left))


def _two(case: Case, scene: Path, _here: Path) -> Seen:
    """Twice at the same time; what the one that was less lucky shows."""
    both = [_started(_words(case, scene)) for _ in range(2)]
    return max((_ended(one) for one in both), key=lambda seen: seen.status)


def _interrupted(case: Case, scene: Path, _here: Path) -> Seen:
    """Ctrl-C in the middle of the work."""
    process = _started(_words(case, scene))
    time.sleep(0.6)
    process.send_signal(signal.SIGINT)
    return _ended(process)


def _words(case: Case, scene: Path) -> list[str]:
    return [*COMMAND, *arguments(case, scene)]


def _started(words: list[str], limit: Callable[[], None] | None = None) -> subprocess.Popen[str]:
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=limit)  # noqa: PLW1509


def _ended(process: subprocess.Popen[str]) -> Seen:
    out, err = process.communicate(timeout=300)
    return Seen(process.returncode, out, err)


_AS_NOBODY = """
import io, os, sys
from contextlib import redirect_stderr, redirect_stdout
from gtlayout.cli.app import main
with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
    main({warm})
os.setgroups([])
os.setgid({user})
os.setuid({user})
sys.exit(main({real}))
"""
"""The first run, as root and elsewhere, loads what the second needs."""
_WAYS = {
    "here": _here,
    "process": _process,
    "nobody": _nobody,
    "small files": _small_files,
    "full disk": _full_disk,
    "two": _two,
    "interrupted": _interrupted,
}
