"""Reading JSON and writing files so that a reader never sees half of one."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.archives import read_bytes
from gtlayout.io.scratch import held, scratch
from gtlayout.signals import deferred

MAX_NAME_BYTES, MAX_PATH_BYTES = 240, 1024
"""Of a file's name and of its path in the scene folder, so that with extension and folder a file system takes them."""

LONG_NUMBER = re.compile(rb"[0-9]{19}")
"""Digits of a whole number that may not fit into 64 bits."""
MAX_DIGITS = 400
"""Of a whole number; no float is that large."""


def write_atomic(path: Path, content: bytes | str) -> None:
    """Write ``content`` to ``path`` (text as UTF-8) through a temporary file beside it; makes the folder if absent.

    Raises GtlayoutError when the folder or the disk does not take it; ``path`` is then as it was.
    """
    write_all_atomic({path: content})


def write_all_atomic(contents: Mapping[Path, bytes | str], remove: Iterable[Path] = ()) -> None:
    """Write several files, in order: all are complete beside their places before the first takes its own.

    A link stays, and what it leads to is written. Devices and pipes are written to, not replaced. Of two that write
    the same files at once one comes after the other. What a killed process left beside these places is overwritten.
    The last of several is gone while the others take their places: where it is, all belong together, whoever is killed.

    Args:
        contents: File → what it is to hold, text as UTF-8.
        remove: Files that would not belong to the new ones; gone before the first of these takes its place.

    Raises GtlayoutError when a folder or the disk does not take one of them; all files are then as they were.
    """
    as_bytes = {path: content.encode() if isinstance(content, str) else content for path, content in contents.items()}
    places = {path: Path(os.path.realpath(path)) for path in contents if not _takes_a_stream(path)}
    temporaries: dict[Path, Path] = {}
    path, made = Path(), list[Path]()
    try:
        with ExitStack() as stack:
            stack.callback(_remove_empty, made)
            for path, place in places.items():
                made += _make(place.parent)
                if path.is_dir():
                    raise GtlayoutError(f"cannot write {path}: a folder is in its place")
            folders = sorted({place.parent for place in places.values()})
            alone = all(stack.enter_context(held(folder)) for folder in folders)
            stack.callback(_unlink, temporaries.values())
            for path, place in places.items():
                temporaries[path] = _temporary(place, alone)
                _unlink([temporaries[path]])
                with temporaries[path].open("xb") as file:  # never through a link that somebody put there
                    file.write(as_bytes[path])
            for path in [path for path in contents if path not in places]:
                path.write_bytes(as_bytes[path])
            with deferred():
                last = list(places.values())[-1:] if len(places) > 1 else []
                _unlink([*last, *remove, *(_temporary(each, alone) for each in remove)])
                for path, temporary in temporaries.items():
                    temporary.replace(places[path])
    except OSError as error:
        raise GtlayoutError(f"cannot write {path}: {error.strerror or error}") from error


def _make(folder: Path) -> list[Path]:
    """Make a folder with those that it lies in; returns the new ones, from the outermost on."""
    missing = [each for each in (folder, *folder.parents) if not each.exists()][::-1]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def _remove_empty(folders: Iterable[Path]) -> None:
    """Those that hold nothing, the innermost, which are the last, first."""
    for folder in reversed([*folders]):
        with suppress(OSError):
            folder.rmdir()


def _temporary(place: Path, alone: bool) -> Path:
    """Beside its place: always the same one for whoever holds the folder."""
    return place.with_name(f".{place.name}.tmp" if alone else f".{place.name}.{os.getpid()}.tmp")


def _unlink(paths: Iterable[Path]) -> None:
    for path in paths:
        with suppress(OSError):
            path.unlink()


def _takes_a_stream(path: Path) -> bool:
    """Whether it is a device, a pipe or a socket, or leads to one: no file can take its place."""
    if path.absolute().parts[:2] in (("/", "dev"), ("/", "proc")):
        return path.exists()  # /dev/stdout may lead to a file that is being written to
    return path.exists() and not path.is_file() and not path.is_dir()


@contextmanager
def let_in() -> Iterator[None]:
    """Raises GtlayoutError naming it where a file or folder may not be looked at: pathlib raises PermissionError even
    when it is only asked whether a file is there.
    """
    try:
        yield
    except PermissionError as error:
        raise GtlayoutError(f"cannot read {error.filename}: {error.strerror}") from error


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """Fill a folder: the one given is called like ``out`` and takes its place in the end, unless something was raised.

    What a killed process left of one beside ``out`` is removed.

    Raises GtlayoutError when ``out`` is there already and not an empty folder, or the disk does not take it.
    """
    taken = GtlayoutError(f"{out} exists and is not an empty folder: name a new one")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise taken
    given, out = out, Path(os.path.realpath(out))  # a link to an empty folder stays one
    filled = out
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with scratch(out.parent, out.name) as beside:
            filled = beside / out.name  # the name may mean something: CAD-Estate calls the clip so
            filled.mkdir()
            yield filled
            filled.rename(out)  # also in place of an empty folder
    except OSError as error:
        if filled != out and error.errno in (errno.ENOTEMPTY, errno.EEXIST):  # somebody else was quicker
            raise taken from error
        raise GtlayoutError(f"cannot write {out}: {error.strerror or error}") from error
    except GtlayoutError as error:
        if str(filled) not in str(error):
            raise
        # The folder that was filled is gone, and nobody has heard of it.
        raise GtlayoutError(str(error).replace(str(filled), str(given))) from error


def write_json_atomic(path: Path, data: Any) -> None:
    """Write ``data`` as ``json_text``. Raises GtlayoutError as ``write_atomic`` does."""
    write_atomic(path, json_text(data))


def json_text(data: Any) -> str:
    """JSON with keys in the order given, floats by repr, NaN and infinity as null: the same bytes for the same data."""
    text = json.dumps(_plain(data), indent=1, ensure_ascii=False, allow_nan=False)
    # A point or a matrix row on one line: strings hold no raw newline, so only layout is touched.
    text = re.sub(r"\[\n\s*([^\[\]{}]*?)\n\s*\]", lambda m: "[" + re.sub(r",\n\s*", ", ", m[1]) + "]", text)
    return text + "\n"


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON file that holds an object. Raises GtlayoutError naming the file when it is absent or no such file."""
    data = _parsed(path)
    if not isinstance(data, dict):
        raise GtlayoutError(f"{path} must hold a JSON object, not a {type(data).__name__}")
    return data


def read_json_list(path: Path) -> list[Any]:
    """Read a JSON file that holds a list. Raises GtlayoutError naming the file when it is absent or no such file."""
    data = _parsed(path)
    if not isinstance(data, list):
        raise GtlayoutError(f"{path} must hold a JSON list, not a {type(data).__name__}")
    return data


def printable(text: str) -> str:
    """Text out of a file, so that it can stand in a message: no line breaks, no signs that a terminal cannot show."""
    return text if text.isprintable() else "".join(sign if sign.isprintable() else "?" for sign in text)


def path_inside(root: Path, relative: str, where: str) -> Path:
    """The file ``relative`` to the scene folder ``root``; links within it are the owner's business.

    Raises GtlayoutError, beginning with ``where``, when the path is absolute, leads out of the folder, or is none:
    too long, or with control characters.
    """
    name = relative.encode("utf-8", "replace")
    if len(name) > MAX_PATH_BYTES or max(map(len, re.split(rb"[/\\]", name))) > MAX_NAME_BYTES:
        raise GtlayoutError(f"{where}: the path {relative[:40]!r}… is too long")
    if any(unicodedata.category(character) in ("Cc", "Cs") for character in relative):
        raise GtlayoutError(f"{where}: the path {relative!r} holds characters that no name has")
    parts: list[str] = []
    for part in relative.replace("\\", "/").split("/"):
        if part == ".." and not parts:
            raise GtlayoutError(f"{where}: the path {relative} leads out of the scene folder")
        if part == "..":
            parts.pop()
        elif part not in ("", "."):
            parts.append(part)
    if re.match(r"[/\\]|[A-Za-z]:", relative) or not parts:
        raise GtlayoutError(f"{where}: the path {relative!r} must be relative to the scene folder")
    return root.joinpath(*parts)


def check_stays(folder: Path, names: Iterable[str]) -> None:
    """Raise GtlayoutError when a file of ``folder`` that is to be written is a link that leads out of it.

    For files that nobody named: a scene of strangers could have its results written over somebody's own files.
    """
    for path in (folder / name for name in names):
        if path.is_symlink() and not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
            raise GtlayoutError(f"cannot write {path}: it is a link that leads out of {folder}: remove it")


def _parsed(path: Path) -> Any:
    """In UTF-8, UTF-16 or UTF-32, with a byte-order mark or without. The file may lie in a zip."""
    content = read_bytes(path)
    try:
        # Python makes whole numbers of any size, or refuses, and others cannot take them: they become floats.
        long = LONG_NUMBER.search(content) is not None or b"\0" in content
        return json.loads(content, parse_int=_whole_number if long else None)
    except (ValueError, RecursionError) as error:
        raise GtlayoutError(f"{path} is not valid JSON: {error}") from error


def _whole_number(digits: str) -> float:
    if len(digits) > MAX_DIGITS:
        return math.copysign(math.inf, -1.0 if digits.startswith("-") else 1.0)
    number = int(digits)
    return number if -(1 << 63) <= number < 1 << 63 else float(digits)


def _plain(value: Any) -> Any:
    """Plain lists, dicts and numbers that JSON can hold."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
