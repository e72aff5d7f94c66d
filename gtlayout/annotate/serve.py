"""The server: on this machine's loopback alone, until Ctrl-C or SIGTERM."""

from __future__ import annotations

import os
import secrets
import signal
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import uvicorn
from starlette.responses import PlainTextResponse
from threadpoolctl import threadpool_limits

from gtlayout.annotate.app import MAX_BODY, Pages, build_app
from gtlayout.annotate.scene import open_scene
from gtlayout.annotate.solver import Solver
from gtlayout.annotate.store import Store
from gtlayout.errors import GtlayoutError
from gtlayout.guard import LOOPBACK, PAGE_HEADERS, Admission, Guard
from gtlayout.results.names import FOLDER
from gtlayout.scene import Scene
from gtlayout.session.session import Session

END_S = 2
"""Requests that have begun may take so long at the end."""


def annotate(root: Path, port: int, announce: Callable[[str], None], cameras: Path | None = None) -> None:
    """Serve the page for a scene folder; ``announce`` is called with its address. Call it from the main thread.

    Drawings go to ``annotations.json``, results of full solves to ``gtlayout`` in the folder. ``port`` 0 takes any free
    one. Raises GtlayoutError when the scene cannot be annotated, or the port is taken.
    """
    # Quick and full solves run at a time, and each would set and restore the number of threads for both.
    with threadpool_limits(limits=1, user_api="blas"), _listening(port) as listening:
        address, server, solver = prepared(root, listening, cameras)
        # uvicorn ends at both signals, and then raises them again for those who were there before it.
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            announce(address)
            server.run(sockets=[listening])
        except KeyboardInterrupt:
            pass
        finally:
            signal.signal(signal.SIGTERM, before)
        if not solver.close():
            # Neither can a solve be interrupted, nor does Python end while a thread is in one: it aborts.
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(0)


def prepared(
    root: Path,
    listening: socket.socket,
    cameras: Path | None = None,
    session: Callable[[Scene], Session] = Session,
) -> tuple[str, uvicorn.Server, Solver]:
    """The address of the page for a scene folder, the server, which is to run on a socket of the loopback, its solver.

    Raises GtlayoutError when the scene cannot be annotated.
    """
    scene = open_scene(root, cameras)
    store = Store(root, scene.frames)
    store.read()
    solver = Solver(scene, session(scene), store.key_frames, root / FOLDER)
    port, token = listening.getsockname()[1], secrets.token_urlsafe(16)
    hosts = {f"{name}:{port}" for name in (LOOPBACK, "localhost")}
    app = Guard(
        build_app(Pages(scene, store, solver), token),
        Admission(MAX_BODY, hosts, token, headers=PAGE_HEADERS),
        lambda status, why: PlainTextResponse(why, status),
    )
    config = uvicorn.Config(
        app, log_level="warning", access_log=False, server_header=False, timeout_graceful_shutdown=END_S
    )
    return f"http://{LOOPBACK}:{port}/{token}/", uvicorn.Server(config), solver


def _listening(port: int) -> socket.socket:
    try:
        return socket.create_server((LOOPBACK, port))
    except OSError as error:
        msg = f"port {port} cannot be served on ({os.strerror(error.errno or 0)}): choose another with --port"
        raise GtlayoutError(msg) from None
