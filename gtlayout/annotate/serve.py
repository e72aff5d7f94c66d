"""The server: on this machine's loopback alone, until Ctrl-C or SIGTERM."""

from __future__ import annotations

import os
import secrets
import signal
import socket
from collections.abc import Callable
from pathlib import Path

import uvicorn

from gtlayout.annotate.app import Pages, build_app
from gtlayout.annotate.assistant import Assistant
from gtlayout.annotate.guard import LOOPBACK, Guard
from gtlayout.annotate.scene import open_scene
from gtlayout.annotate.solver import Solver
from gtlayout.annotate.store import Store
from gtlayout.errors import GtlayoutError
from gtlayout.results.names import FOLDER

END_S = 2
"""Requests that have begun may take so long at the end."""


def annotate(
    root: Path, assistant: Assistant, port: int, announce: Callable[[str], None], cameras: Path | None = None
) -> None:
    """Serve the page for a scene folder; ``announce`` is called with its address. Call it from the main thread.

    Drawings go to ``annotations.json``, results of full solves to ``gtlayout`` in the folder. ``port`` 0 takes any free
    one. Raises GtlayoutError when the scene cannot be annotated, or the port is taken.
    """
    scene = open_scene(root, cameras)
    store = Store(root, scene.frames)
    store.read()
    with _listening(port) as listening:
        token = secrets.token_urlsafe(16)
        solver = Solver(scene, assistant, store.key_frames, root / FOLDER)
        served_port = listening.getsockname()[1]
        app = Guard(build_app(Pages(scene, store, solver, assistant), token), served_port, token)
        config = uvicorn.Config(
            app, log_level="warning", access_log=False, server_header=False, timeout_graceful_shutdown=END_S
        )
        # uvicorn ends at both signals, and then raises them again for those who were there before it.
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            announce(f"http://{LOOPBACK}:{served_port}/{token}/")
            uvicorn.Server(config).run(sockets=[listening])
        except KeyboardInterrupt:
            return
        finally:
            signal.signal(signal.SIGTERM, before)


def _listening(port: int) -> socket.socket:
    try:
        return socket.create_server((LOOPBACK, port))
    except OSError as error:
        msg = f"port {port} cannot be served on ({os.strerror(error.errno or 0)}): choose another with --port"
        raise GtlayoutError(msg) from None
