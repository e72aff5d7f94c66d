"""``gtlayout annotate`` in this process, on the example. Fixtures ``solved_room``, ``undrawn`` and ``drawn``."""

from __future__ import annotations

import http.client
import json
import shutil
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from gtlayout.annotate.assistant import Assistant, Finding, plain
from gtlayout.annotate.serve import prepared
from gtlayout.api import load
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.method import solve
from gtlayout.scene import KeyFrame, Scene
from gtlayout.solution import Solution

ROOM = Path(__file__).parents[1] / "examples/room"


DRAWN = (8, 16)
"""Frames of it that are enough for a room."""


@pytest.fixture(scope="session")
def solved_room() -> Solution:
    """The example as two of its frames are drawn, solved."""
    scene = load(ROOM)
    return solve(replace(scene, key_frames=tuple(one for one in scene.key_frames if one.frame in DRAWN)))


@dataclass
class SolvedSession:
    """Takes no time: the solution of the example, for whatever is drawn in two frames or more."""

    solution: Solution
    calls: list[str] = field(default_factory=list)

    def quick(self, key_frames: Sequence[KeyFrame]) -> Solution:
        return self._given("quick", key_frames)

    def solve(self, key_frames: Sequence[KeyFrame]) -> Solution:
        return self._given("full", key_frames)

    def _given(self, kind: str, key_frames: Sequence[KeyFrame]) -> Solution:
        self.calls.append(kind)
        if len(key_frames) < 2:
            raise GtlayoutError("one frame is not enough")
        return self.solution


def assistant_of(session: SolvedSession, findings: Sequence[Finding] = ()) -> Assistant:
    """All as in ``plain``, but for the solve and the review."""

    def start(_scene: Scene) -> SolvedSession:
        return session

    return replace(plain(), session=start, review=lambda _solution: findings)


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
def annotate_server(root: Path, assistant: Assistant) -> Iterator[str]:
    """The address of the page, while it is served."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        address, server, solver = prepared(root, assistant, listening)
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
