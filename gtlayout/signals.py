"""Ctrl-C and SIGTERM end a program in one line, whatever it is doing. Quick to import."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import FrameType, ModuleType
from typing import NoReturn

_ENDINGS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
_IMPORTING = "<frozen importlib._bootstrap>"
_TAKES_SIGTERM = "pycolmap"
"""Its logging prints a C stack of 35 lines at SIGTERM, whatever was to happen then."""


class Terminated(KeyboardInterrupt):
    """SIGTERM came: all ends as with Ctrl-C."""


def end_in_one_line(name: str) -> None:
    """From now on SIGINT and SIGTERM raise KeyboardInterrupt and ``Terminated`` in the main thread.

    During an import they end the process at once with a line on stderr that begins with ``name``: nothing has been
    begun then that must be tidied up, and modules in C lose exceptions.
    """

    def end(number: int, frame: FrameType | None) -> None:
        if _within_import(frame):
            leave(name, number)
        raise Terminated if number == signal.SIGTERM else KeyboardInterrupt

    for number in _ENDINGS:
        if signal.getsignal(number) != signal.SIG_IGN:  # as for what a shell runs in the background
            signal.signal(number, end)
    keep_sigterm()


def leave(name: str, number: int) -> NoReturn:
    """End the process at once, with one line on stderr."""
    os.write(2, f"{name}: {_ENDINGS[signal.Signals(number)]}\n".encode())
    os._exit(128 + number)


def ending(error: KeyboardInterrupt) -> tuple[str, int]:
    """In a word why a command ended, and its exit status."""
    number = signal.SIGTERM if isinstance(error, Terminated) else signal.SIGINT
    return _ENDINGS[number], 128 + number


def nothing_left_to_end() -> None:
    """All is done, and only the interpreter ends: whoever interrupts that gets the exit status, and no traceback."""
    for number in _ENDINGS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def deferred() -> Iterator[None]:
    """What is done within is done whole: Ctrl-C, SIGTERM and a time limit take effect afterwards. For moments only."""
    if threading.current_thread() is not threading.main_thread():  # which alone is interrupted
        yield
        return
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in (*_ENDINGS, signal.SIGALRM)}
    # What Python does not know (a handler in C), or what ends the process by itself, stays.
    ours = {number: handler for number, handler in before.items() if callable(handler)}
    for number in ours:
        signal.signal(number, lambda number, _frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in ours.items():
            signal.signal(number, handler)
        for late in dict.fromkeys(came):
            signal.raise_signal(late)


def keep_sigterm() -> None:
    """Whoever answers SIGTERM in this process still does so after pycolmap is imported."""
    if not any(isinstance(finder, _KeepsSigterm) for finder in sys.meta_path):
        sys.meta_path.insert(0, _KeepsSigterm())


class _KeepsSigterm(MetaPathFinder, Loader):
    """Imports pycolmap as ever, and has SIGTERM answered as before."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        spec = PathFinder.find_spec(fullname, path) if fullname == _TAKES_SIGTERM else None
        if spec is not None and spec.loader is not None:
            self._loader, spec.loader = spec.loader, self
        return spec

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        try:
            self._loader.exec_module(module)
        finally:
            with suppress(ValueError):  # Only the main thread may.
                signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGTERM) or signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _within_import(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == _IMPORTING:
            return True
        frame = frame.f_back
    return False
