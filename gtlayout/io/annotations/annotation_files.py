"""Which annotation files lie in a folder or a zip, and of which tool: told by their content, not by their names."""

from __future__ import annotations

import io
import json
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Literal, TextIO

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.foreign import FOREIGN_JSON, FOREIGN_NAMES, Foreign, foreign_xml, unreadable
from gtlayout.io.annotations.labels import FILE_NAME as LABELS_FILE
from gtlayout.io.archives import archive_of, members, open_bytes
from gtlayout.io.files import printable

AnnotationKind = Literal["native", "cvat", "coco", "labelme", "label-studio"]

NATIVE_FILE = "annotations.json"
SUFFIXES = (".json", ".xml")
HIDDEN = "._"
"""Begins the name of what macOS puts beside a file on a foreign disk."""
WINDOW = 1 << 16
"""Characters looked at at once."""
OVERLAP = 64
"""No sign is longer."""
MAX_SCAN = 1 << 26
"""Characters; what has shown no sign until then is no annotation file."""
RESULTS_FOLDER = "gtlayout"
"""What is proposed lies there in the formats of other tools; nobody drew it."""
MAX_DEPTH = 2
"""LabelMe's files lie beside the images: in Polycam's scans in ``keyframes/corrected_images``."""
JSON_SIGNS: tuple[tuple[AnnotationKind | Foreign, str, re.Pattern[str]], ...] = (
    ("native", "{", re.compile(r'"gtlayout-annotations/')),
    *FOREIGN_JSON,
    ("label-studio", "[", re.compile(r'"(annotations|completions|result|data|annotation_id|rle|\w{1,40}labels)"\s*:')),
    ("labelme", "{", re.compile(r'"(shapes|imagePath|imageData)"\s*:')),
    ("coco", "{", re.compile(r'"(category_id|categories|image_id|file_name|segmentation)"\s*:')),
)
"""Kind, what the file begins with, and a key. In this order; a key that COCO has, too, may stand in another's file."""


def files_of_kind(kind: AnnotationKind) -> Callable[[Path], list[Path]]:
    """A function that finds the files of one kind at a place, in order of their names; see ``kinds_at``."""

    def find(place: Path) -> list[Path]:
        return [path for path, found in kinds_at(place).items() if found == kind]

    return find


def kinds_at(place: Path) -> dict[Path, AnnotationKind | Foreign]:
    """The annotation files at a place, sorted by name, with the kind of each.

    ``place`` is a file, whatever it is called, a zip or a folder. When a folder holds no file of any kind that is read,
    they are looked for in the folders within it, then in those within them. Raises GtlayoutError when a folder or
    the zip cannot be read.
    """
    if not place.is_dir():
        return kinds_in(place)
    try:
        folders, kinds = [place], kinds_in(place)
        for _ in range(MAX_DEPTH if not readable(kinds) else 0):
            folders = [
                path
                for folder in folders
                for path in sorted(folder.iterdir())
                if path.is_dir() and path.name != RESULTS_FOLDER
            ]
            kinds |= {path: found for folder in folders for path, found in kinds_in(folder).items()}
            if readable(kinds):
                break
    except OSError as error:
        raise GtlayoutError(f"cannot read {place}: {error.strerror or error}") from error
    return kinds


def kinds_in(place: Path) -> dict[Path, AnnotationKind | Foreign]:
    """The annotation files right in a folder, in a zip, or the file ``place`` itself, sorted, with the kind of each.

    A folder's zips are looked into when nothing beside them is read: else they are what that was unpacked from. Raises
    OSError, and GtlayoutError where ``place`` is a zip that cannot be opened.
    """
    if place.is_dir():
        paths = sorted(path for path in place.iterdir() if path.is_file() and not path.name.startswith(HIDDEN))
        kinds = _of([path for path in paths if path.suffix.lower() in SUFFIXES])
        if not readable(kinds):
            for path in filter(_is_zip, paths):
                with suppress(GtlayoutError):  # ``left_out`` will say it.
                    kinds |= kinds_in(path)
        return kinds
    if archive_of(place) == place:
        return _of([path for path in members(place) if path.suffix.lower() in SUFFIXES]) or _by_names(place)
    return _of([place])


def readable(kinds: dict[Path, AnnotationKind | Foreign]) -> bool:
    """Whether any of the files is of a kind that is read."""
    return any(not isinstance(kind, Foreign) for kind in kinds.values())


def left_out(place: Path) -> list[str]:
    """What at ``place`` is not read and should have been, one line each: other formats, zips, a file of no known kind.

    Raises GtlayoutError as ``kinds_at`` does.
    """
    kinds = kinds_at(place)
    formats: defaultdict[Foreign, list[str]] = defaultdict(list)
    for path, kind in kinds.items():
        if isinstance(kind, Foreign):
            formats[kind].append(printable(path.name))
    lines = [
        f"{names[0]}{f' and {len(names) - 1} more' if names[1:] else ''}: {foreign.name}, not read; {foreign.instead}"
        for foreign, names in formats.items()
    ]
    if place.is_dir():
        beside = any(path.parent == place for path, kind in kinds.items() if not isinstance(kind, Foreign))
        zips = [path for path in sorted(place.iterdir()) if path.is_file() and _is_zip(path)]
        return lines + [line for path in zips if (line := _not_opened(path, beside)) is not None]
    if kinds:
        return lines
    return [f"{place.name} {'holds no annotations' if archive_of(place) == place else 'is no file of a known tool'}"]


def _not_opened(archive: Path, beside: bool) -> str | None:
    if beside:
        return f"{archive.name} was not opened: annotations lie beside it"
    try:
        return None if kinds_in(archive) else f"{archive.name} holds no annotations"
    except GtlayoutError as error:
        return str(error)


def _is_zip(path: Path) -> bool:
    return path.suffix.lower() == ".zip" and not path.name.startswith(HIDDEN)


def _of(paths: list[Path]) -> dict[Path, AnnotationKind | Foreign]:
    return {path: kind for path in paths if (kind := _kind(path)) is not None}


def _by_names(archive: Path) -> dict[Path, AnnotationKind | Foreign]:
    """Of a zip without any such file: what the names in it say it is."""
    names = {path.name.lower() for path in members(archive)}
    found = next((foreign for name, foreign in FOREIGN_NAMES if name in names), None)
    return {} if found is None else {archive: found}


def _kind(path: Path) -> AnnotationKind | Foreign | None:
    there = path if path.exists() else archive_of(path) or path
    try:
        stat = there.stat()
        return _recognised(path, stat.st_mtime_ns, stat.st_size)
    except OSError as error:
        return unreadable(error.strerror or str(error))
    except GtlayoutError as error:
        return unreadable(str(error))


@lru_cache(maxsize=4096)
def _recognised(path: Path, _changed_ns: int, _size: int) -> AnnotationKind | Foreign | None:
    """Remembered while the file does not change: every reader asks."""
    if path.name == LABELS_FILE:
        return None
    meant: AnnotationKind | None = "native" if path.name == NATIVE_FILE else None
    with open_bytes(path) as file:
        encoding = json.detect_encoding(file.read(4))
    with open_bytes(path) as file, io.TextIOWrapper(file, encoding, errors="replace") as text:
        windows = _windows(text)
        head = next(windows, "").lstrip()
        if head.startswith("<"):
            return _xml_kind(head)
        if not head.startswith(("{", "[")):
            return meant
        for window in chain([head], windows):
            for kind, opening, sign in JSON_SIGNS:
                if head.startswith(opening) and sign.search(window):
                    return kind
    return meant


def _windows(text: TextIO) -> Iterator[str]:
    """The text in pieces that overlap, so that a sign lies in one of them as a whole."""
    last = ""
    for _ in range(MAX_SCAN // WINDOW):
        window = text.read(WINDOW)
        if not window:
            return
        yield last + window
        last = window[-OVERLAP:]


def _xml_kind(head: str) -> AnnotationKind | Foreign | None:
    """By the outermost element, after declarations and comments."""
    while not re.match(r"<[\w:]", head):
        end = next((end for start, end in (("<?", "?>"), ("<!--", "-->"), ("<!", ">")) if head.startswith(start)), "")
        if not end or end not in head:
            return None
        head = head[head.index(end) + len(end) :].lstrip()
        if not head.startswith("<"):
            return "cvat" if "<annotations" in head else None
    return "cvat" if re.match(r"<annotations\b", head) else foreign_xml(head)
