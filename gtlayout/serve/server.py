"""The server of the ML backend, until Ctrl-C or SIGTERM."""

from __future__ import annotations

import ipaddress
import os
import signal
import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path

import uvicorn

from gtlayout.errors import GtlayoutError
from gtlayout.guard import LOOPBACK, Admission, Credentials, Guard
from gtlayout.io.annotations.labels import read_label_file
from gtlayout.serve.label_studio import MAX_BODY, backend, problem
from gtlayout.serve.solving import BackgroundSolves, drawings_stamp, labels_file, solve_folder

PORT = 9090
"""That of Label Studio's own backends."""
USER, PASSWORD = "BASIC_AUTH_USER", "BASIC_AUTH_PASS"
"""Variables of the environment, as for Label Studio's own backends."""
END_S = 2
"""Requests that have begun may take so long at the end."""


def serve_label_studio(
    root: Path,
    announce: Callable[[str], None],
    *,
    host: str = LOOPBACK,
    port: int = PORT,
    cameras: Path | None = None,
    annotations: Path | None = None,
) -> None:
    """Solve the scene folder ``root``, then serve proposals for it. ``announce`` is called with lines for the user.

    ``cameras`` and ``annotations`` are those of ``load_scene``; ``port`` 0 takes any free one. Call it from the main
    thread. Raises GtlayoutError when the scene cannot be read or solved, the port is taken, or ``host`` lets other
    machines in and no password is set.
    """
    credentials = _credentials()
    if credentials is None and not is_loopback(host):
        raise GtlayoutError(
            f"--host {host} lets other machines in: set {USER} and {PASSWORD} in the environment, and the same in "
            "Label Studio's settings of the model"
        )
    with _listening(host, port) as listening:
        solves = BackgroundSolves(
            partial(solve_folder, root, cameras, annotations), partial(drawings_stamp, root, annotations)
        )
        announce(f"solving {root}")
        solves.refresh()
        solves.wait()
        if solves.problem:
            raise GtlayoutError(solves.problem)
        served_port = listening.getsockname()[1]
        names = {f"{name}:{served_port}" for name in (LOOPBACK, "localhost", "[::1]")} if is_loopback(host) else None
        own_labels = dict(read_label_file(labels_file(root, annotations)))
        app = Guard(backend(solves, own_labels), Admission(MAX_BODY, names, credentials=credentials), problem)
        config = uvicorn.Config(
            app, log_level="warning", access_log=False, server_header=False, timeout_graceful_shutdown=END_S
        )
        # uvicorn ends at both signals, and then raises them again for those who were there before it.
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            announce(f"Label Studio backend: http://{f'[{host}]' if ':' in host else host}:{served_port}")
            uvicorn.Server(config).run(sockets=[listening])
        except KeyboardInterrupt:
            return
        finally:
            signal.signal(signal.SIGTERM, before)


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a server there."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _credentials() -> Credentials | None:
    user, password = os.environ.get(USER, ""), os.environ.get(PASSWORD, "")
    if bool(user) != bool(password):
        raise GtlayoutError(f"only one of {USER} and {PASSWORD} is set: set both, or none")
    return Credentials(user, password) if user else None


def _listening(host: str, port: int) -> socket.socket:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        return socket.create_server(address[:2], family=family)
    except OSError as error:
        why = error.strerror or str(error)
        raise GtlayoutError(f"{host}:{port} cannot be served on ({why}): choose with --port and --host") from None
