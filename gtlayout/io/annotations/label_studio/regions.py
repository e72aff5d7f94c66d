"""Regions of a Label Studio annotation → shapes.

A region is one or more results with the same id: one for every control tag that says something of it, each with the
region's geometry (``Result.serialize`` of Label Studio's editor): labels, choices, texts.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gtlayout.io.annotations.checked import CURVED, Notes, UnusableError, is_px, name
from gtlayout.io.annotations.checked import is_curved as is_said_curved
from gtlayout.io.annotations.label_studio.geometry import HOLDS, is_curved, is_drawn, region_geometry
from gtlayout.io.sources import RawShape
from gtlayout.scene import FloatArray

ID, ELEMENT = "id", "element"
"""Names of the per-region text fields (see ``labeling/label_studio.xml``)."""
SAYS = frozenset({"", "choices", "textarea", "rating", "number", "taxonomy", "datetime", "pairwise"})
"""Types of results, without ``labels`` behind, that say something of a region or an image and draw nothing."""


@dataclass(frozen=True)
class _Region:
    labels: tuple[str, ...]
    id: str | None
    """As the annotator called it, else as the tool does."""
    element: str | None
    parent: str | None
    """The tool's id of the region it was put under."""
    item: int
    """Which image of the task."""
    polygons_percent: tuple[FloatArray, ...]
    lines_percent: tuple[FloatArray, ...]
    curved: bool


def shapes_by_image(
    results: Sequence[Any], notes: Notes, where: str
) -> dict[int, tuple[tuple[int, int], list[RawShape]]]:
    """``result`` of an annotation → per image of the task: its (width, height) px, and its shapes.

    The element of a region is what its text ``element`` says, else the region it is related to, either way round, or
    was put under. A region with several labels is a shape for each. What is broken goes to ``notes``.
    """
    grouped: dict[str | int, list[dict[str, Any]]] = {}
    related: defaultdict[str, list[str]] = defaultdict(list)
    sizes: dict[int, tuple[int, int]] = {}
    for number, result in enumerate(results):
        if not isinstance(result, dict):
            notes.add("result skipped: it is no object", where)
        elif result.get("type") == "relation":
            one, other = name(result.get("from_id")), name(result.get("to_id"))
            if one and other:
                related[one].append(other)
                related[other].append(one)
            else:
                notes.add("relation skipped: it does not name two regions", where)
        else:
            grouped.setdefault(name(result.get("id")) or number, []).append(result)
            if size := _size(result):
                sizes.setdefault(_item(result), size)
    regions: dict[str | int, _Region] = {}
    for key, same in grouped.items():
        try:
            if region := _region(key, same, sizes, notes, where):
                regions[key] = region
        except UnusableError as why:
            notes.add(f"region skipped: {why}", where)
    shapes: dict[int, tuple[tuple[int, int], list[RawShape]]] = {item: (size, []) for item, size in sizes.items()}
    for key, region in regions.items():
        size, found = shapes[region.item]
        partners = [regions[other] for other in (*related.get(str(key), ()), region.parent or "") if other in regions]
        element = region.element or next((p.id for p in partners if p.labels != region.labels), None)
        if element is None and len(region.labels) > 1:
            element = region.id
        polygons, lines = (
            tuple(points * size / 100 for points in each) for each in (region.polygons_percent, region.lines_percent)
        )
        found += [
            RawShape(label, polygons, lines, id=region.id, element=element, curved=region.curved)
            for label in region.labels
        ]
    return shapes


def _region(
    key: str | int, same: Sequence[dict[str, Any]], sizes: dict[int, tuple[int, int]], notes: Notes, where: str
) -> _Region | None:
    said = [result for result in same if result.get("from_name") == CURVED and isinstance(result.get("value"), dict)]
    same = [result for result in same if result.get("from_name") != CURVED]
    values = [result["value"] for result in same if isinstance(result.get("value"), dict)]
    labels = [label for value in values for each in value if each.endswith("labels") for label in _names(value[each])]
    # Polygons without labels of their own may have a choice for each region instead.
    labels = labels or [label for value in values for label in _names(value.get("choices"))]
    kinds = _kinds(same, values)
    if kinds and not kinds & HOLDS.keys():
        raise UnusableError(f"it is of type {min(kinds)}, not polygon, brush, vector or rectangle")
    drawn = next((value for value in values if is_drawn(value, sorted(kinds & HOLDS.keys()))), None)
    if drawn is None:
        if not kinds and (not labels or all(result.get("type") == "choices" for result in same)):
            return None  # It is about the whole image.
        raise UnusableError("it lacks the geometry of a polygon, brush, vector or rectangle")
    if not labels:
        raise UnusableError("it has no label")
    item = _item(same[0])
    size = next(filter(None, map(_size, same)), None) or sizes.get(item)
    if size is None:
        raise UnusableError("original_width and original_height are missing")
    sizes.setdefault(item, size)
    texts_by_tag = _texts_by_tag(same)
    polygons, lines = region_geometry(drawn, size)
    if is_curved(drawn):
        notes.add("curved vector read as straight between its points", where)
    own = key if isinstance(key, str) else None
    parent = next(filter(None, (name(result.get("parentID")) for result in same)), None)
    labels = list(dict.fromkeys(labels))
    chosen = [choice for result in said for choice in _names(result["value"].get("choices"))]
    curved = is_said_curved(chosen[0] if chosen else texts_by_tag.get(CURVED), notes, where)
    return _Region(
        tuple(labels), texts_by_tag.get(ID, own), texts_by_tag.get(ELEMENT), parent, item, polygons, lines, curved
    )


def _kinds(same: Sequence[dict[str, Any]], values: Sequence[dict[str, Any]]) -> set[str]:
    """What was drawn, as Label Studio calls it: by ``type``, or in JSON-MIN by the key of the labels."""
    types = [result["type"] for result in same if isinstance(result.get("type"), str)]
    types += [key for value in values for key in value if key.endswith("labels")]
    kinds = {each.removesuffix("labels") for each in types} - SAYS
    return {name(kind) or "unknown" for kind in kinds}


def _texts_by_tag(same: Sequence[dict[str, Any]]) -> dict[str, str]:
    """What text fields say of a region, or, as ``element: w1``, its note."""
    texts_by_tag: dict[str, str] = {}
    for result in same:
        meta = result.get("meta")
        notes = _names(meta.get("text")) if isinstance(meta, dict) else ()
        for key, text in re.findall(rf"\b({ID}|{ELEMENT}|{CURVED})\s*[:=]\s*(\S+)", " ".join(notes)):
            texts_by_tag.setdefault(key, text)
    for result in same:
        tag, value = result.get("from_name"), result.get("value")
        if tag in (ID, ELEMENT) and isinstance(value, dict) and (texts := _names(value.get("text"))):
            texts_by_tag[tag] = texts[0]
    return texts_by_tag


def _names(value: Any) -> list[str]:
    values = value if isinstance(value, list) else [value]
    return [text for each in values if isinstance(each, str) and (text := name(each))]


def _size(result: dict[str, Any]) -> tuple[int, int] | None:
    size = [result.get("original_width"), result.get("original_height")]
    width, height = (int(v) if is_px(v) and v >= 1 and int(v) == v else 0 for v in size)
    return (width, height) if width and height else None


def _item(result: dict[str, Any]) -> int:
    index = result.get("item_index")
    return index if type(index) is int else 0
