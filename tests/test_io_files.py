"""Atomic writes and paths that stay where they belong."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import (
    new_folder,
    path_inside,
    read_json,
    write_all_atomic,
    write_atomic,
    write_json_atomic,
)
from gtlayout.synth import SynthConfig, synthesize


@pytest.fixture(scope="module")
def solved_small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    room = tmp_path_factory.mktemp("small") / "room"
    synthesize(room, SynthConfig(frames=12, width=160, height=120, oversample=1))
    assert main(["solve", str(room)]) == 0
    return room


def test_json_is_stable_and_says_null(tmp_path: Path) -> None:
    data = {"b": np.array([[0.1, np.nan], [1.0, 2.0]]), "a": (np.float32(0.5), np.int64(3), "x,\n [1]", float("inf"))}
    write_json_atomic(tmp_path / "new/a.json", data)
    text = (tmp_path / "new/a.json").read_text()
    assert json.loads(text) == {"b": [[0.1, None], [1.0, 2.0]], "a": [0.5, 3, "x,\n [1]", None]}
    assert "[0.1, null]" in text
    assert text.index('"b"') < text.index('"a"')
    assert read_json(tmp_path / "new/a.json") == json.loads(text)


def test_failed_write_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken/file").touch()
    with pytest.raises(GtlayoutError, match=r"cannot write .*taken"):
        write_atomic(tmp_path / "taken", "text")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
    with pytest.raises(GtlayoutError, match="cannot write"):
        write_atomic(tmp_path / "taken/file/below", b"bytes")


@pytest.mark.parametrize("text", ["", "{", "[]", "[" * 100_000, "\xff"])
def test_bad_json_names_the_file(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(GtlayoutError, match=r"bad\.json"):
        read_json(tmp_path / "bad.json")


def test_paths_stay_inside(tmp_path: Path) -> None:
    assert path_inside(tmp_path, "./images//a/../b.png", "f") == tmp_path / "images/b.png"
    assert path_inside(tmp_path, "images\\b.png", "f") == tmp_path / "images/b.png"
    for bad in ("../b.png", "images/../../b.png", "/etc/passwd", "C:\\b.png", "", ".", "a\0b"):
        with pytest.raises(GtlayoutError, match=r"^f: the path"):
            path_inside(tmp_path, bad, "f")


def test_links_stay_and_lead_to_what_is_written(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/there").write_text("old")
    for name, leads_to in (("link", "elsewhere/there"), ("dangling", "elsewhere/new")):
        (tmp_path / name).symlink_to(leads_to)
        write_atomic(tmp_path / name, "new")
        assert (tmp_path / name).is_symlink()
        assert (tmp_path / leads_to).read_text() == "new"
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["dangling", "elsewhere", "link", "new", "there"]


@pytest.mark.parametrize("command", [["solve"], ["report"], ["export", "--to", "ply"]])
def test_what_a_scene_holds_never_has_files_elsewhere_written_over(
    command: list[str], solved_small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its results folder came with links to somebody's own files."""
    room, mine = tmp_path / "room", tmp_path / "mine"
    shutil.copytree(solved_small, room)
    mine.write_text("mine")
    for name in ("layout.ply", "report.html"):
        (room / "gtlayout" / name).unlink(missing_ok=True)
        (room / "gtlayout" / name).symlink_to(mine)
    assert main([command[0], str(room), *command[1:]]) == 1
    assert "is a link that leads out of" in capsys.readouterr().err
    assert mine.read_text() == "mine"


def test_pipes_and_devices_are_written_to(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_all_atomic({tmp_path / "file": "a", pipe: "through"})
    assert os.read(reader, 99) == b"through"
    os.close(reader)
    assert pipe.is_fifo()
    (tmp_path / "null").symlink_to(os.devnull)
    write_atomic(tmp_path / "null", "gone")
    assert Path(os.devnull).is_char_device()
    if Path("/dev/full").exists():
        with pytest.raises(GtlayoutError, match="cannot write /dev/full: No space left"):
            write_all_atomic({tmp_path / "file": "b", Path("/dev/full"): "x"})
        assert Path("/dev/full").is_char_device()
        assert (tmp_path / "file").read_text() == "a"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "null", "pipe"]


def test_a_new_folder_behind_a_link(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "link").symlink_to("empty")
    with new_folder(tmp_path / "link") as filled:
        (filled / "file").touch()
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "empty/file").exists()
