"""From drawn shapes to elements: parts put together, visible parts given to their elements, overlaps resolved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.io.annotations.outlines import polygonal, united
from gtlayout.scene import OPENINGS, Element, Label

_SAME_PX2 = 0.75
"""Overlaps that differ by less are a tie; corners on half pixels make areas that differ by quarters, halves or more."""
TWICE_IOU = 0.9
"""Two elements of one label with this IoU are one that was drawn twice."""


@dataclass(frozen=True)
class DrawnElement:
    """An element, or a part of one, in the pinhole image."""

    label: Label
    amodal: MultiPolygon
    visible: MultiPolygon
    id: str | None
    group: str | None
    z_order: int
    curved: bool = False


@dataclass(frozen=True)
class DrawnVisible:
    """A visible part that was drawn as a shape of its own."""

    region: MultiPolygon
    element: str | None
    """Id of the element it is marked to belong to."""
    group: str | None


def assemble(drawn: Sequence[DrawnElement], visible: Sequence[DrawnVisible]) -> tuple[tuple[Element, ...], list[str]]:
    """The elements of one image, and the problems, one line each.

    Elements that share id and label, or group and label, become one. A visible part goes to the element it names,
    else to the one of its group, or of all, that it overlaps most; if that is a tie, to the smallest. Where elements of
    different ``z_order`` overlap, the lower one ends. Doors and windows lie in their walls, whatever their order is.
    Of elements that were drawn twice the first stays.
    Elements without a name of their own are called ``wall_1`` and so on.
    """
    whole = _put_together(drawn)
    names = _names(whole)
    seen: list[list[MultiPolygon]] = [[element.visible] for element in whole]
    notes = []
    for part in visible:
        owner, note = _owner(part, whole, names)
        if owner is not None:
            seen[owner].append(part.region)
        if note:
            notes.append(note)
    elements = []
    for element, name, parts in zip(whole, names, seen, strict=True):
        amodal = _not_behind(element, whole)
        if amodal.is_empty:
            notes.append(f"element {name}: elements with a higher z-order cover all of it, dropped")
            continue
        elements.append(Element(name, element.label, amodal, _union(parts), element.curved))
    once, doubles = _once(elements)
    return once, [*notes, *doubles]


def _once(elements: Sequence[Element]) -> tuple[tuple[Element, ...], list[str]]:
    """Of elements that were drawn twice the first, with the visible parts of both, and what was left out.

    Each would be an instance of its own, which hides the other.
    """
    kept: list[Element] = []
    notes = []
    for element in elements:
        for i, other in enumerate(kept):
            if other.label == element.label and _iou(other.amodal, element.amodal) > TWICE_IOU:
                seen = _union([other.visible, element.visible])
                kept[i] = replace(other, visible=seen, curved=other.curved or element.curved)
                notes.append(
                    f"{element.label} {element.id} left out: almost the same polygon as {element.label} {other.id}"
                )
                break
        else:
            kept.append(element)
    return tuple(kept), notes


def _iou(one: MultiPolygon, other: MultiPolygon) -> float:
    largest, smallest = max(one.area, other.area), min(one.area, other.area)
    if smallest <= TWICE_IOU * largest:
        return smallest / largest
    both = one.intersection(other).area
    return float(both / (one.area + other.area - both))


def _put_together(drawn: Sequence[DrawnElement]) -> list[DrawnElement]:
    parts: dict[object, list[DrawnElement]] = {}
    for i, element in enumerate(drawn):
        of_id, of_group = ("id", element.id, element.label), ("group", element.group, element.label)
        key = of_id if element.id is not None else of_group if element.group is not None else i
        parts.setdefault(key, []).append(element)
    return [
        same[0]
        if len(same) == 1
        else replace(
            same[0],
            amodal=_union([part.amodal for part in same]),
            visible=_union([part.visible for part in same]),
            z_order=max(part.z_order for part in same),
            curved=any(part.curved for part in same),
        )
        for same in parts.values()
    ]


def _names(whole: Sequence[DrawnElement]) -> list[str]:
    """Unique names: ids where they are, numbered labels elsewhere."""
    taken = {element.id for element in whole}
    counts: Counter[str] = Counter()
    names: list[str] = []
    for element in whole:
        name = element.id
        # One id with two labels is two elements; the second is told apart like one without an id.
        while name is None or name in names or (element.id is None and name in taken):
            counts[element.label] += 1
            name = f"{element.label}_{counts[element.label]}"
        names.append(name)
    return names


def _owner(part: DrawnVisible, whole: Sequence[DrawnElement], names: Sequence[str]) -> tuple[int | None, str | None]:
    everyone = range(len(whole))
    named = [i for i in everyone if part.element is not None and part.element in (whole[i].id, names[i])]
    grouped = [i for i in everyone if part.group is not None and part.group == whole[i].group]
    note = None
    if part.element is not None and not named:
        note = f"a visible part belongs to element {part.element}, which is not there: given to what it overlaps most"
    candidates = named or grouped or list(everyone)
    if len(named) == 1:
        return named[0], None
    shared = shapely.intersection(part.region, np.array([whole[i].amodal for i in candidates], dtype=object))
    overlaps = dict(zip(candidates, shapely.area(shared).tolist(), strict=True))
    most = max(overlaps.values(), default=0.0)
    if most == 0:
        return None, "a visible part lies on no element, dropped"
    tied = [i for i in candidates if overlaps[i] > most - _SAME_PX2]
    return max(tied, key=lambda i: (whole[i].z_order, -whole[i].amodal.area)), note


def _not_behind(element: DrawnElement, whole: Sequence[DrawnElement]) -> MultiPolygon:
    if element.label in OPENINGS:
        return element.amodal
    before = [e.amodal for e in whole if e.label not in OPENINGS and e.z_order > element.z_order]
    return polygonal(element.amodal - shapely.union_all(before)) if before else element.amodal


def _union(regions: Sequence[MultiPolygon]) -> MultiPolygon:
    there = [region for region in regions if not region.is_empty]
    return there[0] if len(there) == 1 else united(there)
