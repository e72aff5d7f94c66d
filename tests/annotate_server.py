"""``gtlayout annotate`` in this process, on the example. Fixtures ``two_drawn``, ``undrawn`` and ``drawn``."""

from __future__ import annotations

import http.client
import json
import shutil
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from gtlayout.annotate.serve import prepared
from gtlayout.api import load
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.method import solve
from gtlayout.scene import KeyFrame, Scene
from gtlayout.session.session import Session
from gtlayout.solution import Solution

ROOM = Path(__file__).parents[1] / "examples/room"


DRAWN = (8, 16)
"""Frames of it that are enough for a room."""


@pytest.fixture(scope="session")
def two_drawn() -> Solution:
    """The example as two of its frames are drawn, solved."""
    scene = load(ROOM)
    return solve(replace(scene, key_frames=tuple(one for one in scene.key_frames if one.frame in DRAWN)))


class SolvedSession(Session):
    """Takes no time: the solution of the example, for whatever is drawn in two frames or more."""

    def __init__(self, solution: Solution) -> None:
        super().__init__(solution.scene)
        self.solution = solution
        self.calls: list[str] = []

    def quick(self, key_frames: Sequence[KeyFrame]) -> Solution:
        return self._given("quick", key_frames)

    def solve(self, key_frames: Sequence[KeyFrame]) -> Solution:
        return self._given("full", key_frames)

    def _given(self, kind: str, key_frames: Sequence[KeyFrame]) -> Solution:
        self.calls.append(kind)
        if len(key_frames) < 2:
            raise GtlayoutError("one frame is not enough")
        return self.solution


@dataclass(frozen=True)
class Answer:
    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


@dataclass(frozen=True)
class Client:
    """Asks the server, as the page does unless told otherwise."""

    address: str

    def __call__(
        self, method: str, path: str, body: object = None, headers: dict[str, str | None] | None = None, token: str = ""
    ) -> Answer:
        parts = urlsplit(self.address)
        own = f"{parts.scheme}://{parts.netloc}"
        given = {"Host": parts.netloc, "Origin": None if method == "GET" else own, **(headers or {})}
        connection = http.client.HTTPConnection("127.0.0.1", parts.port or 0, timeout=20)
        content = body if isinstance(body, bytes) else None if body is None else json.dumps(body).encode()
        at = f"/{token}/" if token else parts.path
        connection.putrequest(method, at + path, skip_host=True)
        for name, value in given.items():
            if value is not None:
                connection.putheader(name, value)
        if content is not None:
            connection.putheader("Content-Length", str(len(content)))
        connection.endheaders(content)
        response = connection.getresponse()
        answer = Answer(response.status, {k.lower(): v for k, v in response.getheaders()}, response.read())
        connection.close()
        return answer


@contextmanager
def annotate_server(root: Path, session: Session | None = None) -> Iterator[str]:
    """The address of the page, while it is served; all is solved for real unless there is a session."""

    def begun(scene: Scene) -> Session:
        return session or Session(scene)

    with socket.create_server(("127.0.0.1", 0)) as listening:
        address, server, solver = prepared(root, listening, session=begun)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        try:
            yield address
        finally:
            server.should_exit = True
            thread.join(timeout=10)
            assert not thread.is_alive()
            solver.close()


@pytest.fixture
def undrawn(tmp_path: Path) -> Path:
    """The example without annotations."""
    folder = tmp_path / "room"
    shutil.copytree(ROOM, folder, ignore=shutil.ignore_patterns("annotations.json", "gtlayout", "depth"))
    return folder


@pytest.fixture
def drawn(undrawn: Path) -> Path:
    """The example as two of its frames are drawn."""
    data = read_json(ROOM / "annotations.json")
    write_json_atomic(undrawn / "annotations.json", {**data, "frames": data["frames"][1:3]})
    return undrawn


def until(true: Callable[[], bool], seconds: float = 20.0) -> None:
    """Wait for something that another thread does."""
    waited = threading.Event()
    for _ in range(round(seconds / 0.05)):
        if true():
            return
        waited.wait(0.05)
    pytest.fail(f"it did not happen within {seconds:g} s")
