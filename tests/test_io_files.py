"""Atomic writes and paths that stay where they belong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import path_inside, read_json, write_atomic, write_json_atomic


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
