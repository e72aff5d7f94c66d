"""What is written beside its place: one writer at a time, remains of killed ones go, nothing is written in between."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from gtlayout.errors import GtlayoutError
from gtlayout.io import scratch as module
from gtlayout.io.files import new_folder, write_all_atomic, write_atomic
from gtlayout.io.scratch import held, scratch
from gtlayout.signals import deferred

KILLED_WITHIN = """
import os, sys
from pathlib import Path
from gtlayout.io import files
from gtlayout.io.files import new_folder, write_all_atomic

out = Path(sys.argv[1])
if sys.argv[2] == "folder":
    with new_folder(out / "new") as folder:
        (folder / "half").write_text("half")
        os.kill(os.getpid(), 9)
if sys.argv[2] == "files":
    files.deferred = lambda: os.kill(os.getpid(), 9)  # all is written, nothing has its place yet
replace = Path.replace
Path.replace = lambda self, to: os.kill(os.getpid(), 9) if to.name == "b" else replace(self, to)
write_all_atomic({out / "a": "new", out / "b": "new"})
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def die_within(out: Path, what: str) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED_WITHIN, str(out), what], check=False)
    assert done.returncode == -signal.SIGKILL


def test_remains_of_killed_writers_go_when_it_is_written_again(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    die_within(tmp_path, "files")
    assert (tmp_path / "a").read_text() == "old"
    assert names(tmp_path) == [".a.tmp", ".b.tmp", "a"]
    write_all_atomic({tmp_path / "a": "newer"}, remove=[tmp_path / "b"])
    assert names(tmp_path) == ["a"]
    assert (tmp_path / "a").read_text() == "newer"


def test_files_of_two_runs_are_never_taken_for_one(tmp_path: Path) -> None:
    write_all_atomic({tmp_path / "a": "old", tmp_path / "b": "old"})
    die_within(tmp_path, "between")
    assert names(tmp_path) == [".b.tmp", "a"]
    write_all_atomic({tmp_path / "a": "newer", tmp_path / "b": "newer"})
    assert names(tmp_path) == ["a", "b"]


def test_remains_of_a_folder_go_but_not_those_in_use_or_of_others(tmp_path: Path) -> None:
    die_within(tmp_path, "folder")
    assert len(names(tmp_path)) == 1
    (tmp_path / ".newer.abcdefgh").mkdir()
    (tmp_path / ".new.abcdefgh").symlink_to(tmp_path / ".newer.abcdefgh")
    with scratch(tmp_path, "new") as in_use:
        with new_folder(tmp_path / "new") as filled:
            (filled / "whole").touch()
        assert in_use.is_dir()
        assert names(tmp_path) == sorted([".new.abcdefgh", ".newer.abcdefgh", in_use.name, "new"])
    assert names(tmp_path) == [".new.abcdefgh", ".newer.abcdefgh", "new"]


def test_what_lies_beside_is_never_written_through(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / ".a.tmp").symlink_to("mine")
    write_atomic(tmp_path / "a", "new")
    assert (tmp_path / "mine").read_text() == "mine"
    assert not (tmp_path / "a").is_symlink()


def test_two_writers_at_once_write_one_after_the_other(tmp_path: Path) -> None:
    """Never files of both: while one has the folder, the other waits."""
    with held(tmp_path) as alone:
        assert alone
        writer = threading.Thread(target=write_all_atomic, args=({tmp_path / "a": "2", tmp_path / "b": "2"},))
        writer.start()
        time.sleep(0.2)
        assert names(tmp_path) == []
    writer.join()
    assert names(tmp_path) == ["a", "b"]


def test_nobody_waits_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE_S", 0.1)
    with held(tmp_path), held(tmp_path) as alone:
        assert not alone
        (tmp_path / ".a.tmp").write_text("of whoever holds it")
        write_atomic(tmp_path / "a", "new")
        assert names(tmp_path) == [".a.tmp", "a"]


def test_nothing_ends_in_between(tmp_path: Path) -> None:
    """Ctrl-C comes while files take their places: it is answered, afterwards."""
    done = []
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # libraries set their own
    try:
        with pytest.raises(KeyboardInterrupt), deferred():
            os.kill(os.getpid(), signal.SIGINT)
            done.append(True)
        assert done
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_failed_write_removes_nothing(tmp_path: Path) -> None:
    (tmp_path / "old").touch()
    (tmp_path / "folder").mkdir()
    with pytest.raises(GtlayoutError):
        write_all_atomic({tmp_path / "folder": ""}, remove=[tmp_path / "old"])
    assert names(tmp_path) == ["folder", "old"]
