"""rerun's viewers: the native one in its window, the web viewer on this machine's loopback."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO
from urllib.parse import quote

from gtlayout.errors import GtlayoutError
from gtlayout.extras import MissingExtraError

VIEWER_PORT = 9876
"""Where a rerun viewer listens by default."""
WEB_PORT = 9090
"""Where the web viewer is served by default; its log comes over the port after it."""
_LOOPBACK = "127.0.0.1"
_START_S = 30.0
"""A server that does not answer after so long will not."""


def require_display() -> None:
    """Raise ``GtlayoutError`` when a viewer's window has nowhere to open."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        msg = (
            "no rerun viewer can start: there is no display here; use `gtlayout solve --rerun save` and then "
            "`gtlayout view --web`, or copy log.rrd to a machine with a screen and run `rerun log.rrd` there"
        )
        raise GtlayoutError(msg)


def require_viewer(port: int = VIEWER_PORT) -> None:
    """Raise ``GtlayoutError`` when no viewer listens on this machine (rerun itself would wait and drop the data)."""
    if not _listens(port):
        msg = f"no rerun viewer listens on port {port}: start one with `rerun`, or use --rerun spawn"
        raise GtlayoutError(msg)


def open_log(log: Path) -> None:
    """Open a saved log in a viewer and wait until its window is closed.

    Raises ``GtlayoutError`` when the log is missing or the viewer cannot start.
    """
    _require_log(log)
    require_display()
    viewer = subprocess.run([rerun_command(), log], capture_output=True, text=True, check=False)
    if viewer.returncode != 0:
        raise _ended(viewer.returncode, viewer.stderr)


def serve_log(log: Path, port: int, announce: Callable[[str], None]) -> None:
    """Serve a saved log and rerun's web viewer to this machine alone, until Ctrl-C or SIGTERM.

    ``announce`` is called with the address once it answers. The page comes from ``port``, the log from the port after
    it: fixed, so that both can be forwarded. Rerun's Python functions would listen on all interfaces, its command can
    be told not to. Call it from the main thread.

    Raises ``GtlayoutError`` when the log is missing, a port is taken or the server ends.
    """
    _require_log(log)
    for needed in (port, port + 1):
        _require_free(needed)
    command = [rerun_command(), "--serve-web", "--bind", _LOOPBACK]
    command += ["--web-viewer-port", str(port), "--port", str(port + 1), str(log)]
    # Killed rather than interrupted, the server would be left behind and keep its ports.
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with TemporaryFile("w+") as output, _group(command, output) as server:
            try:
                _await(server, port)
                if server.poll() is None:
                    source = quote(f"rerun+http://{_LOOPBACK}:{port + 1}/proxy", safe="")
                    announce(f"http://{_LOOPBACK}:{port}/?url={source}")
                status = server.wait()
            finally:
                # The command is a Python script that waits for the real server: both have to go.
                with suppress(ProcessLookupError):
                    os.killpg(server.pid, signal.SIGTERM)
            output.seek(0)
            raise _ended(status, output.read())
    except KeyboardInterrupt:
        return
    finally:
        signal.signal(signal.SIGTERM, before)


def rerun_command() -> str:
    """The ``rerun`` command that rerun-sdk installs beside Python, which need not be on the PATH."""
    found = shutil.which("rerun", path=Path(sys.executable).parent) or shutil.which("rerun")
    if found is None:
        raise MissingExtraError("the rerun viewer is not installed: pip install 'gtlayout[view]'")
    return found


def _require_log(log: Path) -> None:
    if not log.is_file():
        msg = f"{log} does not exist: make it with `gtlayout solve --rerun save`"
        raise GtlayoutError(msg)


def _require_free(port: int) -> None:
    try:
        socket.create_server((_LOOPBACK, port)).close()
    except OSError as error:
        msg = f"port {port} cannot be served on ({os.strerror(error.errno or 0)}): choose another with --port"
        raise GtlayoutError(msg) from None


def _group(command: Sequence[str], output: IO[str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True)


def _await(server: subprocess.Popen[bytes], port: int) -> None:
    """Wait until something answers on ``port`` or the server has ended."""
    give_up = time.monotonic() + _START_S
    while server.poll() is None and not _listens(port):
        if time.monotonic() > give_up:
            msg = f"the rerun web viewer does not answer on port {port} after {_START_S:g} s"
            raise GtlayoutError(msg)
        time.sleep(0.1)


def _listens(port: int) -> bool:
    try:
        socket.create_connection((_LOOPBACK, port), timeout=1.0).close()
    except OSError:
        return False
    return True


def _ended(status: int, output: str) -> GtlayoutError:
    reason = (output.strip().splitlines() or ["no reason given"])[-1]
    return GtlayoutError(f"the rerun viewer ended with status {status}: {reason}")
