"""Which annotation files lie in a scene folder, and of which tool: told by how they begin, not by their names."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from gtlayout.errors import GtlayoutError

AnnotationKind = Literal["native", "cvat", "coco", "labelme", "label-studio"]

NATIVE_FILE = "annotations.json"
HEAD_BYTES = 1 << 16
"""Every format has said what it is by then."""
JSON_SIGNS: tuple[tuple[AnnotationKind, str], ...] = (
    ("native", r'"gtlayout-annotations/'),
    ("labelme", r'"(shapes|imagePath)"\s*:'),
    ("label-studio", r'\A\s*\[\s*\{.*"(annotations|completions|result|data)"\s*:'),
    ("coco", r'\A\s*\{.*"(category_id|categories)"\s*:'),
)
"""In this order; a key that COCO has, too, may stand in another's file."""


def files_of_kind(kind: AnnotationKind) -> Callable[[Path], list[Path]]:
    """A function that finds the files of one kind in a scene folder, in order of their names.

    They are looked for in the folders within it, too, when the scene folder itself holds no file of any kind. An
    ``annotations.json`` of no known kind counts as native: it is meant to be one. The function raises GtlayoutError
    when a folder cannot be read.
    """

    def find(root: Path) -> list[Path]:
        try:
            kinds = _kinds(root)
            if not kinds:
                below = [_kinds(folder) for folder in sorted(root.iterdir()) if folder.is_dir()]
                kinds = {path: found for each in below for path, found in each.items()}
        except OSError as error:
            raise GtlayoutError(f"cannot read {root}: {error.strerror or error}") from error
        return [path for path, found in kinds.items() if found == kind]

    return find


def _kinds(folder: Path) -> dict[Path, AnnotationKind]:
    files = [path for path in sorted(folder.iterdir()) if path.suffix in (".json", ".xml") and path.is_file()]
    return {path: kind for path in files if (kind := _kind(path)) is not None}


def _kind(path: Path) -> AnnotationKind | None:
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES).decode("utf-8", errors="replace")
    except OSError:
        return None  # Whoever reads the file will say so.
    if path.suffix == ".xml":
        return "cvat" if "<annotations" in head else None
    meant: AnnotationKind | None = "native" if path.name == NATIVE_FILE else None
    return next((kind for kind, sign in JSON_SIGNS if re.search(sign, head, re.DOTALL)), meant)
