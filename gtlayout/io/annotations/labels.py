"""The meaning of an annotation tool's labels."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, get_args

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json
from gtlayout.scene import LABELS, Label

FILE_NAME = "labels.json"
Kind = Label | Literal["visible", "occlusion_edge", "blank", "ignored"]
"""A structural element, a visible part of one, an edge along which neighbours do not touch, a part of the image that is
left blank on purpose, or ignored."""
KINDS: tuple[Kind, ...] = (*LABELS, "visible", "blank", "occlusion_edge", "ignored")
SYNONYMS: dict[str, Kind] = {
    "ground": "floor",
    "slantedceiling": "slanted",
    "slantedwall": "slanted",
    "slantedsurface": "slanted",
    "slope": "slanted",
    "slopedceiling": "slanted",
    "visiblepart": "visible",
    "visiblearea": "visible",
    "visibleregion": "visible",
    "occlusion": "occlusion_edge",
    "occlusionboundary": "occlusion_edge",
    "occludingedge": "occlusion_edge",
}


def label_meanings(own: Mapping[str, Kind]) -> Mapping[str, Kind]:
    """Labels in their simple form (see ``simple_form``) and as written → what they mean; ``own`` goes first."""
    known: dict[str, Kind] = {simple_form(kind): kind for kind in KINDS if kind != "ignored"}
    simple_own = {simple_form(label): kind for label, kind in own.items() if simple_form(label)}
    return {**known, **SYNONYMS, **simple_own, **own}


def meaning(label: str, meanings: Mapping[str, Kind]) -> Kind | None:
    """What a label means: ``Floor``, ``floor_1``, ``floors`` and ``FLOOR 02`` are all floor. None = unknown."""
    simple = simple_form(label)
    return meanings.get(label) or meanings.get(simple) or meanings.get(simple.removesuffix("s"))


def simple_form(label: str) -> str:
    """Its letters in lower case: without numbers, blanks and signs."""
    return re.sub(r"[\W\d_]+", "", label.casefold())


def read_label_file(path: Path) -> Mapping[str, Kind]:
    """Read ``labels.json``, ``{"<a label of the tool>": "wall" | … | null}``; null = ignore it without a warning.

    No file, no labels. Raises GtlayoutError when it holds something else.
    """
    if not path.exists():
        return {}
    own: dict[str, Kind] = {}
    for label, value in read_json(path).items():
        kind = "ignored" if value is None else next((kind for kind in KINDS if kind == value), None)
        if kind is None:
            raise GtlayoutError(
                f"{path}: {label!r} means {value!r}; known are {', '.join(get_args(Label))}, "
                "visible, occlusion_edge, blank, and null for what is to be ignored"
            )
        own[label] = kind
    return own
