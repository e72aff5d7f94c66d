"""Which annotation files lie in a scene folder, and of which tool: recognised by their content, not by their names."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from gtlayout.errors import GtlayoutError

AnnotationKind = Literal["native", "cvat", "coco", "labelme", "label-studio"]

NATIVE_FILE = "annotations.json"
HEAD_BYTES = 1 << 16
"""Every format can be recognised within this length."""
MAX_DEPTH = 2
"""LabelMe's files lie beside the images: in Polycam's scans in ``keyframes/corrected_images``."""
JSON_SIGNS: tuple[tuple[AnnotationKind, str], ...] = (
    ("native", r'"gtlayout-annotations/'),
    ("label-studio", r'\A\s*\[\s*\{.*"(annotations|completions|result|data|annotation_id|rle|\w+labels)"\s*:'),
    ("labelme", r'"(shapes|imagePath)"\s*:'),
    ("coco", r'\A\s*\{.*"(category_id|categories|image_id|file_name)"\s*:'),
)
"""In this order; a key that COCO has, too, may stand in another's file."""


def files_of_kind(kind: AnnotationKind) -> Callable[[Path], list[Path]]:
    """A function that finds the files of one kind in a scene folder, in order of their names.

    When it holds no file of any kind they are looked for in the folders within it, then in those within them. An
    ``annotations.json`` of no known kind counts as native: it is meant to be one. The function raises GtlayoutError
    when a folder cannot be read.
    """

    def find(root: Path) -> list[Path]:
        try:
            folders, kinds = [root], kinds_in(root)
            for _ in range(MAX_DEPTH if not kinds else 0):
                folders = [path for folder in folders for path in sorted(folder.iterdir()) if path.is_dir()]
                kinds = {path: found for folder in folders for path, found in kinds_in(folder).items()}
                if kinds:
                    break
        except OSError as error:
            raise GtlayoutError(f"cannot read {root}: {error.strerror or error}") from error
        return [path for path, found in kinds.items() if found == kind]

    return find


def kinds_in(folder: Path) -> dict[Path, AnnotationKind]:
    """The annotation files right in ``folder``, sorted by name, with the kind of each. Raises OSError."""
    files = [path for path in sorted(folder.iterdir()) if path.suffix in (".json", ".xml") and path.is_file()]
    return {path: kind for path in files if (kind := _kind(path)) is not None}


def _kind(path: Path) -> AnnotationKind | None:
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES).decode("utf-8", errors="replace")
    except OSError:
        return None  # The reader of the file will report it.
    if path.suffix == ".xml":
        return "cvat" if "<annotations" in head else None
    meant: AnnotationKind | None = "native" if path.name == NATIVE_FILE else None
    return next((kind for kind, sign in JSON_SIGNS if re.search(sign, head, re.DOTALL)), meant)
