"""Where names, lengths and areas stand in a floor plan: off every line, and off one another.

A label stands beside its wall where there is room, else further away at the end of a thin line that leads to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import shapely
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from gtlayout.export.floor_plan import FloorPlan
from gtlayout.export.helvetica import text_width
from gtlayout.export.plan_curves import Curve
from gtlayout.export.plan_rooms import Room
from gtlayout.export.plan_shapes import DESCENT, SMALL_TEXT_MM, TEXT_MM, Line, Text, directions
from gtlayout.export.plan_walls import Footprint
from gtlayout.figures import short
from gtlayout.scene import OPENINGS, FloatArray

CLEAR_MM = 0.8
"""Between a label and everything else."""
NEXT_ROW_MM, ROWS = 4.5, 3
FIRST_ROW_MM = 2.0
PLACES = (0.5, 0.25, 0.75)
"""Along the wall."""
MOST_OVERHANG = 1.5
"""A text beside its wall is at most so much longer than the wall."""
LEADS_MM = tuple(range(6, 90, 4))
"""Lengths of the lines that lead to a label, and their directions from straight across the wall."""
LEADS_DEG = tuple(
    side * turn for turns in (range(0, 80, 10), range(180, 100, -10)) for turn in turns for side in (1.0, -1.0)
)
LEAD_START_MM = 1.0
STEEP = 0.35
"""Where a lead runs less to the side than this, its label is centred over or below its end."""
UPRIGHT_DEG = 75.0
"""Texts fall to the right by no more than this."""
AREA_MM = 3.0
LINE_SHARE = 1.7
"""From line to line, of the height of capitals."""
ROOM_GRID = 24
_NEARLY = 1 - 1e-6


@dataclass(frozen=True)
class Free:
    """What labels keep off."""

    lines: Sequence[BaseGeometry]
    """Neither texts nor leads lie on them."""
    areas: Sequence[BaseGeometry]
    """Texts do not lie on them."""


@dataclass(frozen=True)
class Label:
    """Lines of text that belong together, and the line that leads to them, if any."""

    texts: tuple[Text, ...]
    lead: FloatArray | None = None
    """(2, 2)."""

    @property
    def boxes(self) -> list[BaseGeometry]:
        """What its texts cover."""
        return [text.box for text in self.texts]

    @property
    def leads(self) -> list[BaseGeometry]:
        """Its lead, or nothing."""
        return [] if self.lead is None else [LineString(self.lead)]

    def is_legible(self, free: Free, covered: Sequence[BaseGeometry], gap: float) -> bool:
        """Whether its texts come no nearer than ``gap`` to anything, and its lead to no other label."""
        boxes, lines = self.boxes, [*free.lines, *free.areas]
        return not (_near(boxes, lines, gap) or _near(boxes, covered, gap) or _near(self.leads, covered, gap))


def _best(candidates: Iterable[Label], free: Free, covered: Sequence[BaseGeometry], gap: float) -> Label | None:
    """The first that is legible and whose lead crosses no line; without one, as in a corner of short walls, the first
    that is legible.
    """
    crossing = None
    for label in candidates:
        if label.is_legible(free, covered, gap):
            if not _near(label.leads, free.lines, gap):
                return label
            crossing = crossing or label
    return crossing


def _near(shapes: Sequence[BaseGeometry], others: Sequence[BaseGeometry], gap: float) -> bool:
    # What is exactly as far, but for rounding, is far enough.
    return any(shapely.dwithin(shape, others, gap * _NEARLY).any() for shape in shapes)


def upright(angle_deg: float) -> float:
    """The same direction or the opposite one: so that a text reads from below or from the right."""
    return (angle_deg + UPRIGHT_DEG) % 180.0 - UPRIGHT_DEG


def labels(plan: FloorPlan, free: Free, mm: float) -> tuple[list[Text], list[Line], tuple[str, ...]]:
    """Areas of rooms, then names and lengths of doors and windows, then of walls, the longest first; of curved
    walls the radius.

    ``mm`` of paper in world units. Returns the texts, the lines that lead to them, and the texts for which there is no
    place.
    """
    gap = CLEAR_MM * mm
    placed: list[Label] = []
    covered: list[BaseGeometry] = []
    missing: list[str] = []
    # To the millimetre on paper: walls that are as long but for rounding keep their order.
    named = sorted((*plan.openings, *plan.walls), key=lambda one: (one.label not in OPENINGS, -round(one.length / mm)))
    wanted: list[Callable[[], Iterable[Label]]] = [
        partial(_room_labels, one, free.lines, plan.metric, mm) for one in plan.rooms
    ]
    wanted += [partial(_labels, one, label_text(one, plan.metric), mm) for one in named]
    wanted += [partial(_labels, one.middle, curve_text(one, plan.metric), mm) for one in plan.curves]
    for candidates in wanted:
        label = _best(candidates(), free, covered, gap)
        if label is None:
            missing.append(", ".join(text.text for text in next(iter(candidates())).texts))
        else:
            placed.append(label)
            covered += [*label.boxes, *label.leads]
    texts = [text for label in placed for text in label.texts]
    return texts, [Line("labels", one.lead) for one in placed if one.lead is not None], tuple(missing)


def label_text(one: Footprint, metric: bool) -> str:
    """``wall_0 4.08 m LOA20``: name, length as drawn, level of accuracy where it has one."""
    length = f"{one.length:.2f} m" if metric else short(one.length)
    level = f" LOA{one.accuracy_level}" if one.accuracy_level else ""
    return f"{one.name} {length}{level}"


def curve_text(one: Curve, metric: bool) -> str:
    """``wall_0 r 1.20 m LOA20``: name, radius, level of accuracy where it has one."""
    radius = f"{one.radius:.2f} m" if metric else short(one.radius)
    level = f" LOA{one.accuracy_level}" if one.accuracy_level else ""
    return f"{one.name} r {radius}{level}"


def area_texts(room: Room, metric: bool) -> tuple[str, ...]:
    """``at least 12.30 m²`` where walls do not close the room; what is inferred is said apart."""

    def area(size: float) -> str:
        return f"{size:.2f} m²" if metric else f"{short(size)} square units"

    certainty = "at least " if room.open else "about " if room.weak else ""
    with_inferred = float(room.region.union(room.inferred).area)
    more = () if room.inferred.is_empty else (f"{area(with_inferred)} with what is inferred",)
    return f"{certainty}{area(room.area)}", *more


def _labels(one: Footprint, words: str, mm: float) -> Iterator[Label]:
    """The best first: beside the wall and along it, outside it rather than inside; then further away."""
    height = (SMALL_TEXT_MM if one.label in OPENINGS else TEXT_MM) * mm
    angle = upright(float(np.rad2deg(np.arctan2(one.along[1], one.along[0]))))
    first_row = max(FIRST_ROW_MM * mm, one.reach + 2 * CLEAR_MM * mm + DESCENT * height)
    text = Text("labels", words, one.ends[0], height, angle)
    for side in (-1.0, 1.0):
        for place in [
            place for place in PLACES if text.width <= MOST_OVERHANG * 2 * min(place, 1 - place) * one.length
        ]:
            for row in range(ROWS):
                away = first_row + row * NEXT_ROW_MM * mm + height / 2
                at = one.ends[0] + place * one.length * one.along + side * away * one.inside
                yield Label((Text("labels", words, at, height, angle),))
    middle = one.ends[0] + _middle(one) * one.along
    out = float(np.rad2deg(np.arctan2(-one.inside[1], -one.inside[0])))
    for lead in LEADS_MM:
        for turn in LEADS_DEG:
            way, _ = directions(out + turn)
            tip = middle + lead * mm * way
            yield Label(
                (_at_tip(words, tip, way, height, CLEAR_MM * mm),),
                np.stack([middle + LEAD_START_MM * mm * way, tip]),
            )


def _middle(one: Footprint) -> float:
    """Distance from the first end: amid the longest part that is drawn."""
    if not len(one.drawn):
        return one.length / 2
    longest = one.drawn[np.argmax(np.diff(one.drawn, axis=1)[:, 0].round(9))]
    return float(longest.mean())


def _at_tip(words: str, tip: FloatArray, way: FloatArray, height: float, gap: float) -> Text:
    """A level text at the end of a line that comes ``way``."""
    half = np.array([text_width(words, height) / 2, (0.5 + DESCENT) * height]) + gap
    axis = 0 if abs(way[0]) > STEEP else 1
    return Text("labels", words, tip + np.sign(way[axis]) * half[axis] * np.eye(2)[axis], height)


def _room_labels(room: Room, lines: Sequence[BaseGeometry], metric: bool, mm: float) -> list[Label]:
    """The area and the name below it within the room, the farther from all lines the better."""
    sizes = (AREA_MM * mm, *(SMALL_TEXT_MM * mm for _ in area_texts(room, metric)))
    words = (*area_texts(room, metric), room.name)
    low, high = np.reshape(room.region.bounds, (2, 2))
    across = [np.linspace(low[axis], high[axis], ROOM_GRID + 2)[1:-1] for axis in range(2)]
    places = []
    for at in np.stack(np.meshgrid(*across), axis=-1).reshape(-1, 2):
        texts, below = [], at
        for text, height in zip(words, sizes, strict=True):
            texts.append(Text("labels", text, below, height))
            below = below - np.array([0.0, LINE_SHARE * height])
        places.append(Label(tuple(texts)))
    boxes = np.array([shapely.union_all(label.boxes).envelope for label in places])
    free = shapely.distance(boxes, shapely.union_all([*lines, room.region.boundary]))
    aside = shapely.distance(boxes, room.region.centroid)
    size = float(np.linalg.norm(high - low))
    inside = shapely.contains(room.region, boxes)
    # Rounded: which of two equally good places is taken must not depend on the last bit.
    order = np.lexsort([(aside / size).round(3), -(free / size).round(3)])
    return [places[k] for k in order if inside[k]] or places[:1]
