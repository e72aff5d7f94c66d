"""``gtlayout view --web`` as a process of its own, and ports for it. Fixture ``free_ports``."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@pytest.fixture
def free_ports() -> int:
    """A free port before another free one."""
    for port in range(19300, 19400, 2):
        try:
            for one in (port, port + 1):
                socket.create_server(("127.0.0.1", one)).close()
        except OSError:
            continue
        return port
    pytest.skip("no two free ports")


@contextmanager
def web_viewer(log: Path, port: int, end: signal.Signals = signal.SIGINT) -> Iterator[str]:
    """The address that it prints, while it runs; ``end`` stops it with status 0."""
    # SIGINT is as in a terminal, also where the tests are started from a shell that ignores it.
    call = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    call += "from gtlayout.cli.app import main; sys.exit(main())"
    command = [sys.executable, "-c", call, "view", str(log.parent), "--layout", str(log.parent), "--web"]
    with subprocess.Popen([*command, "--port", str(port)], stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        try:
            yield running.stdout.readline().strip()
        finally:
            running.send_signal(end)
            try:
                assert running.wait(timeout=10) == 0
            finally:
                running.kill()  # one that does not stop would be waited for without end
