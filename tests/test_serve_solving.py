"""Solved again behind the server when the drawings change, and the command that serves."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from shutil import copytree
from threading import Event
from typing import Any

import pytest
from serving import ask

from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.labeling import label_config
from gtlayout.serve.server import is_loopback, serve_label_studio
from gtlayout.serve.solved_room import SolvedRoom
from gtlayout.serve.solving import BackgroundSolves, Stamp, drawings_stamp

Edit = Callable[[Path, Callable[[Any], object]], None]
ROOT = Path(__file__).parents[1]


class Folder:
    """A folder whose drawings have a number; what is made of them is said in advance."""

    def __init__(self, *made: SolvedRoom | GtlayoutError | Exception | None) -> None:
        self.number, self.begun, self._made = 0, 0, iter(made)
        self.has_begun, self.may_go_on = Event(), Event()
        self.may_go_on.set()
        self.damage: GtlayoutError | None = None

    def stamp(self) -> Stamp:
        if self.damage is not None:
            raise self.damage
        return (("annotations.json", self.number, 1),)

    def make(self) -> SolvedRoom | None:
        self.begun += 1
        self.has_begun.set()
        assert self.may_go_on.wait(30)
        found = next(self._made)
        if isinstance(found, Exception):
            raise found
        return found


def _refreshed(solves: BackgroundSolves) -> tuple[bool, str]:
    changed = solves.refresh()
    solves.wait()
    return changed, solves.state


def test_only_what_has_changed_is_solved(served_room: SolvedRoom) -> None:
    folder = Folder(None, served_room)
    solves = BackgroundSolves(folder.make, folder.stamp)
    assert _refreshed(solves) == (True, "nothing drawn")
    assert _refreshed(solves) == (False, "nothing drawn")
    assert folder.begun == 1
    folder.number += 1
    assert _refreshed(solves) == (True, "ready")
    assert solves.room is served_room


@pytest.mark.parametrize(
    ("failure", "said"),
    [(GtlayoutError("no cameras"), "no cameras"), (ValueError("a bug"), "ValueError: a bug")],
)
def test_what_was_there_stays_when_a_solve_fails(served_room: SolvedRoom, failure: Exception, said: str) -> None:
    folder = Folder(served_room, failure, served_room)
    solves = BackgroundSolves(folder.make, folder.stamp)
    assert _refreshed(solves) == (True, "ready")
    folder.number += 1
    assert _refreshed(solves) == (True, "failed")
    assert said in solves.problem
    assert solves.room is served_room
    assert _refreshed(solves) == (False, "failed")
    folder.number += 1
    assert _refreshed(solves) == (True, "ready")
    assert solves.problem == ""


def test_a_change_during_a_solve_is_solved_after_it_once(served_room: SolvedRoom) -> None:
    folder = Folder(None, served_room)
    folder.may_go_on.clear()
    solves = BackgroundSolves(folder.make, folder.stamp)
    assert solves.refresh()
    assert solves.state == "solving"
    assert folder.has_begun.wait(30)
    for _ in range(3):
        folder.number += 1
        assert solves.refresh()
    assert folder.begun == 1
    folder.may_go_on.set()
    solves.wait()
    assert (folder.begun, solves.state, solves.room) == (2, "ready", served_room)


def test_a_folder_that_cannot_be_read_is_said(served_room: SolvedRoom) -> None:
    folder = Folder(served_room)
    solves = BackgroundSolves(folder.make, folder.stamp)
    assert _refreshed(solves) == (True, "ready")
    folder.damage = GtlayoutError("cannot read room")
    assert _refreshed(solves) == (False, "failed")
    assert (solves.problem, solves.room) == ("cannot read room", served_room)


def test_the_stamp_is_that_of_the_annotations(tiny: Path, edit_json: Edit) -> None:
    first = drawings_stamp(tiny)
    (tiny / "notes.txt").write_text("nothing")
    assert drawings_stamp(tiny) == first
    (tiny / "labels.json").write_text("{}")
    second = drawings_stamp(tiny)
    assert second != first
    edit_json(tiny / "annotations.json", lambda data: data["frames"].pop())
    third = drawings_stamp(tiny)
    assert third != second
    elsewhere = tiny / "later"
    elsewhere.mkdir()
    (elsewhere / "annotations.json").write_bytes((tiny / "annotations.json").read_bytes())
    assert drawings_stamp(tiny) == third
    assert [path for path, _, _ in drawings_stamp(tiny, Path("later"))] == [str(elsewhere / "annotations.json")]
    with pytest.raises(GtlayoutError, match=r"no annotations gone\.xml"):
        drawings_stamp(tiny, Path("gone.xml"))


@pytest.mark.parametrize(
    ("host", "own"),
    [
        *((own, True) for own in ("127.0.0.1", "127.8.0.1", "localhost", "::1")),
        *((other, False) for other in ("0.0.0.0", "::", "10.0.0.1", "host.docker.internal")),
    ],
)
def test_what_only_this_machine_reaches(host: str, own: bool) -> None:
    assert is_loopback(host) is own


def test_other_machines_need_a_password(tiny: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve", "--label-studio", str(tiny), "--host", "0.0.0.0", "--port", "0"]) == 1
    said = capsys.readouterr().err
    assert "--host 0.0.0.0 lets other machines in: set BASIC_AUTH_USER and BASIC_AUTH_PASS" in said


def test_half_a_password_is_refused(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BASIC_AUTH_USER", "me")
    with pytest.raises(GtlayoutError, match="only one of BASIC_AUTH_USER and BASIC_AUTH_PASS is set"):
        serve_label_studio(tiny, print, port=0)


def test_a_port_that_is_taken_and_a_scene_that_is_none(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(GtlayoutError, match=f"127.0.0.1:{port} cannot be served on"):
            serve_label_studio(tmp_path, print, port=port)
    with pytest.raises(GtlayoutError, match="no cameras in"):
        serve_label_studio(tmp_path, print, port=0)


@pytest.fixture
def served(tiny_room: Path, tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], str, Path]]:
    """``gtlayout serve`` on a copy of the small room: process, address and folder."""
    folder = copytree(tiny_room, tmp_path / "room")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "gtlayout", "serve", "--label-studio", str(folder), "--port", "0"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=environment, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == f"solving {folder}\n"
        address = process.stdout.readline().removeprefix("Label Studio backend: ").strip()
        yield process, address, folder
        process.kill()


def test_the_command_serves_until_it_is_ended_and_follows_the_drawings(
    served: tuple[subprocess.Popen[str], str, Path], edit_json: Edit
) -> None:
    process, address, folder = served
    tasks = [{"data": {"image": f"{i:06d}.jpg"}} for i in (4, 99)]
    asked = {"tasks": tasks, "label_config": label_config("label-studio")}
    status, answer = ask(f"{address}/predict", asked)
    assert status == 200
    assert "2 frames drawn" in answer["model_version"]
    assert [bool(each["result"]) for each in answer["results"]] == [True, False]
    assert ask(f"{address}/health", headers={"Host": "evil.example"})[0] == 403
    edit_json(folder / "annotations.json", lambda data: data["frames"].pop())
    assert ask(f"{address}/webhook", {"action": "ANNOTATION_DELETED"})[1]["result"] == "solving again"
    while ask(f"{address}/health")[1]["state"] == "solving":
        pass
    assert "1 frame drawn" in ask(f"{address}/health")[1]["model_version"]
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "000099.jpg: nothing is proposed, it has no camera" in said.splitlines()
    assert "Traceback" not in said
    assert json.loads((folder / "annotations.json").read_text())["frames"]
