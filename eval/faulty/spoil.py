"""How files are spoiled."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from faulty.case import Spoil

Change = Callable[[Any], object]


def all_of(*spoils: Spoil) -> Spoil:
    """One after another."""

    def spoil(folder: Path) -> None:
        for each in spoils:
            each(folder)

    return spoil


def nothing(_folder: Path) -> None:
    """The scene as it is."""


def gone(name: str) -> Spoil:
    """A file that is missing."""
    return lambda folder: (folder / name).unlink()


def put(name: str, content: bytes | str) -> Spoil:
    """A file with another content, or one more."""

    def spoil(folder: Path) -> None:
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content.encode() if isinstance(content, str) else content)

    return spoil


def cut(name: str, share: float = 0.5) -> Spoil:
    """A file of which only the beginning is there."""

    def spoil(folder: Path) -> None:
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content[: int(share * len(content))])

    return spoil


def edited(name: str, change: Change) -> Spoil:
    """A JSON file, changed in place; NaN and infinity are written as Python does."""

    def spoil(folder: Path) -> None:
        data = json.loads((folder / name).read_text(encoding="utf-8"))
        change(data)
        (folder / name).write_text(json.dumps(data), encoding="utf-8")

    return spoil


def replaced(name: str, old: str, new: str) -> Spoil:
    """Text of a file, wherever it stands."""

    def spoil(folder: Path) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        assert old in text, f"{name} has no {old!r}"
        (folder / name).write_text(text.replace(old, new), encoding="utf-8")

    return spoil


def a_folder(name: str) -> Spoil:
    """A folder in the place of a file."""

    def spoil(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        (folder / name).mkdir()

    return spoil


def pixels(name: str, change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> Spoil:
    """An image or a depth map, coded anew."""

    def spoil(folder: Path) -> None:
        path = folder / name
        before = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert before is not None
        ok, coded = cv2.imencode(path.suffix, np.ascontiguousarray(change(before)))
        assert ok
        path.write_bytes(coded.tobytes())

    return spoil


def each_image(change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> Spoil:
    """All images of a scene."""

    def spoil(folder: Path) -> None:
        for path in sorted((folder / "images").iterdir()):
            pixels(f"images/{path.name}", change)(folder)

    return spoil
