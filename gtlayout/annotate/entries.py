"""Frame entries of annotations.json as the page sends them: looked at before they are written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.checked import is_px

Entry = dict[str, Any]
"""One of ``frames`` in annotations.json."""

MAX_NAME = 200
"""Characters of an element's id or label."""
MAX_POINTS = 100_000
"""Of all shapes of a frame together."""


def checked(entry: object, image: str) -> Entry:
    """The entry of the frame called ``image``, with all keys it came with. Raises GtlayoutError, naming what is wrong.

    An element needs an id of its own, a label and a polygon of three points at least, an occlusion edge two points.
    """
    if not isinstance(entry, Mapping):
        raise GtlayoutError(f"frame {image}: the drawing is no JSON object")
    points = 0
    seen: set[str] = set()
    for number, element in enumerate(_list(entry, "elements", f"frame {image}")):
        where = f"frame {image}, element number {number}"
        if not isinstance(element, Mapping):
            raise GtlayoutError(f"{where} is no JSON object")
        name = _name(element, "id", where)
        _name(element, "label", where)
        if name in seen:
            raise GtlayoutError(f"frame {image}: two elements are called {name}")
        seen.add(name)
        where = f"frame {image}, element {name}"
        points += _lines(element, "polygons", where, least=3) + _lines(element, "visible", where, least=3)
        if not element.get("polygons"):
            raise GtlayoutError(f"{where} has no polygon")
    points += _lines(entry, "occlusion_edges", f"frame {image}", least=2)
    points += _lines(entry, "blank", f"frame {image}", least=3)
    if points > MAX_POINTS:
        raise GtlayoutError(f"frame {image}: more than {MAX_POINTS} points are drawn in it")
    return {**entry, "image": image}


def is_empty(entry: Mapping[str, Any]) -> bool:
    """Whether nothing at all is drawn in it."""
    return not any(entry.get(key) for key in ("elements", "occlusion_edges", "blank"))


def digest(entry: Mapping[str, Any] | None) -> str:
    """What tells one state of a frame from another; empty for none."""
    if entry is None:
        return ""
    return hashlib.sha256(json.dumps(entry, sort_keys=True).encode()).hexdigest()[:16]


def _list(data: Mapping[str, Any], key: str, where: str) -> Sequence[Any]:
    value = data.get(key, [])
    if not isinstance(value, list):
        raise GtlayoutError(f"{where}: {key} is no list")
    return value


def _name(element: Mapping[str, Any], key: str, where: str) -> str:
    value = element.get(key)
    if not isinstance(value, str) or not 0 < len(value) <= MAX_NAME:
        raise GtlayoutError(f"{where}: its {key} must be a text of 1 to {MAX_NAME} characters")
    return value


def _lines(data: Mapping[str, Any], key: str, where: str, least: int) -> int:
    """How many points there are in the lines under ``key``, each of which needs ``least``."""
    lines = _list(data, key, where)
    for line in lines:
        if not isinstance(line, list) or len(line) < least:
            raise GtlayoutError(f"{where}: a line in {key} has fewer than {least} points")
        for point in line:
            if not (isinstance(point, list) and len(point) == 2 and all(is_px(value) for value in point)):
                raise GtlayoutError(f"{where}: {key} has a point that is no pair of pixels")
    return sum(map(len, lines))
