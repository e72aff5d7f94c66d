"""What is written beside its place until it is whole: folders are held against other writers, remains are removed."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

PATIENCE_S = 10.0
"""For another writer, who needs a moment only; one that was stopped in between keeps nobody from writing."""
POLL_S = 0.02
_RANDOM = "[a-z0-9_]{8}"
"""What the standard library ends the name of a temporary folder with."""


@contextmanager
def held(folder: Path) -> Iterator[bool]:
    """Hold a folder that is there: whoever else asks for it waits. The system lets go of it when this process is gone.

    Yields whether it is held: not where its file system knows no locks, or another has held it for ``PATIENCE_S``.
    """
    with ExitStack() as stack:
        yield _hold(folder, stack, PATIENCE_S)


@contextmanager
def scratch(parent: Path, name: str) -> Iterator[Path]:
    """A new folder in ``parent``, gone in the end; its name is hidden and begins with ``name``.

    Those of the same name that killed processes have left are removed first. Raises OSError.
    """
    with ExitStack() as stack:
        with held(parent) as alone:  # nobody takes the new folder for a remain before it is held
            if alone:
                _remove_left(parent, re.compile(rf"\.{re.escape(name)}\.{_RANDOM}"))
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix=f".{name}.", dir=parent)))
            _hold(folder, stack, 0)
        yield folder


def _remove_left(parent: Path, called: re.Pattern[str]) -> None:
    """The folders called so that nobody holds."""
    for entry in [entry for entry in os.scandir(parent) if called.fullmatch(entry.name)]:
        if entry.is_dir(follow_symlinks=False) and entry.stat(follow_symlinks=False).st_uid == os.geteuid():
            with ExitStack() as stack:
                if _hold(Path(entry.path), stack, 0):
                    shutil.rmtree(entry.path, ignore_errors=True)


def _hold(folder: Path, stack: ExitStack, patience_s: float) -> bool:
    until = time.monotonic() + patience_s
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        return False
    stack.callback(os.close, descriptor)
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= until:
                return False
            time.sleep(POLL_S)
        except OSError:
            return False
        else:
            return True
