"""A small room, solved once, for what serves proposals; and requests to a server."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.error import HTTPError
from urllib.request import ProxyHandler, Request, build_opener

import pytest
import uvicorn
from starlette.types import ASGIApp

from gtlayout.serve.solved_room import SolvedRoom
from gtlayout.serve.solving import solve_folder
from gtlayout.synth import SynthConfig, synthesize

SIZE = (160, 120)
FRAMES = 12
OPENER = build_opener(ProxyHandler({}))


@pytest.fixture(scope="session")
def tiny_room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene folder that is solved in a second; frames 0 and 8 are drawn. Copy it before changing it."""
    folder = tmp_path_factory.mktemp("serving") / "room"
    synthesize(folder, SynthConfig(frames=FRAMES, width=SIZE[0], height=SIZE[1]))
    return folder


@pytest.fixture(scope="session")
def served_room(tiny_room: Path) -> SolvedRoom:
    """Of the tiny room."""
    made = solve_folder(tiny_room)
    assert made is not None
    return made


@contextmanager
def running(app: ASGIApp) -> Iterator[str]:
    """Serve an application; gives its address."""
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="critical"))
    thread = Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive()
        thread.join(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        server.should_exit = True
        thread.join()


def ask(url: str, data: object = None, headers: Mapping[str, str] | None = None) -> tuple[int, dict[str, Any]]:
    """Status and JSON; POST where there is data: bytes as they are, anything else as JSON."""
    content = data if isinstance(data, bytes | None) else json.dumps(data).encode()
    asked = Request(url, content, {"Content-Type": "application/json", **(headers or {})})
    try:
        with OPENER.open(asked, timeout=60) as answer:
            return answer.status, json.loads(answer.read())
    except HTTPError as error:
        return error.code, json.loads(error.read())
