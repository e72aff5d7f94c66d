"""What goes wrong in solver processes of ``gtlayout batch`` where a scene asks for it; the program knows nothing of it.

With this folder on PYTHONPATH every Python process imports this file; it acts in solver processes only. A scene asks by
a file ``.fault`` that holds the name of a function below, and "once" if it is to go well afterwards. A hidden file is
no input: adding or removing it leaves the scene the same. It happens while the scene's annotations are read.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

SOLVER = "gtlayout.batch.solver"
MARKER = ".fault"
STEP_BYTES = 32 << 20


def hang() -> NoReturn:
    """In Python: other threads go on."""
    while True:
        time.sleep(1)


def stuck() -> NoReturn:
    """In C, holding the lock of the interpreter: no other thread goes on."""
    while True:
        ctypes.PyDLL(None).pause()


def memory() -> NoReturn:
    """More and more of it, 1 GiB/s or so, all of it touched."""
    taken = []
    while True:
        taken.append(b"\1" * STEP_BYTES)
        time.sleep(0.02)


def segfault() -> None:
    """As from a wild pointer in a library."""
    ctypes.string_at(0)


def killed() -> None:
    """As the system does when memory runs out."""
    os.kill(os.getpid(), signal.SIGKILL)


def leave() -> NoReturn:
    """As a library that calls exit()."""
    os._exit(7)


def bug() -> NoReturn:
    """An exception that nobody expects."""
    raise RuntimeError("a bug of the test")


def lose_worker() -> None:
    """The worker that waits for this process is gone, as with its machine; the process itself may go on."""
    os.kill(os.getppid(), signal.SIGKILL)


FAULTS: dict[str, Callable[[], None]] = {
    each.__name__: each for each in (hang, stuck, memory, segfault, killed, leave, bug, lose_worker)
}


def _watch(event: str, arguments: tuple[object, ...]) -> None:
    """An audit hook: called whenever a file is opened, among others."""
    if event != "open" or not str(arguments[0]).endswith("annotations.json") or not _loading():
        return
    marker = Path(str(arguments[0])).with_name(MARKER)
    if marker.is_file():
        name, *once = marker.read_text(encoding="utf-8").split()
        if once:
            marker.unlink()
        FAULTS[name]()


def _loading() -> bool:
    """Whether it is to be solved: before that it is looked at whether it has changed."""
    frame = sys._getframe()
    while frame is not None and frame.f_code.co_name != "load_scene":
        frame = frame.f_back  # type: ignore[assignment]
    return frame is not None


if SOLVER in sys.orig_argv:
    sys.addaudithook(_watch)
