"""The column beside a floor plan: scale, rooms, heights, what the lines mean, and what the drawing does not know."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from gtlayout.export import unit
from gtlayout.export.floor_plan import FloorPlan, PlanDimension
from gtlayout.export.helvetica import text_width
from gtlayout.export.plan_labels import area_texts
from gtlayout.export.plan_measures import MEANING, length_text
from gtlayout.export.plan_shapes import SMALL_TEXT_MM, TEXT_MM, TICK_MM, Area, Layer, Line, Text
from gtlayout.export.plan_walls import BAND_SIGMAS
from gtlayout.scene import FloatArray

COLUMN_MM, GAP_MM = 62.0, 12.0
"""Its width, and its distance from the plan."""
TITLE_MM, LINE_MM, PARAGRAPH_MM = 3.5, 3.8, 2.0
SAMPLE_MM, SAMPLE_HEIGHT_MM = 9.0, 2.4
BAR_MM = 40.0
"""Longest scale bar."""
MEANINGS: dict[Layer, str] = {
    "walls": "wall: its inner side",
    "sigma": f"± {BAND_SIGMAS:g} standard deviations of a wall's place",
    "weak_walls": "wall whose place is too uncertain to build from: it may be off by more than {weak}",
    "doors": "door: its opening",
    "windows": "window",
    "floor": "floor that was seen",
    "open": "end of what was seen: no wall known here",
    "inferred": "inferred: continued where nobody looked",
    "slanted": "slanted surface above",
}
WEAK = ("2 % of the plan's size", "15 cm")
"""Without metres, and with."""


@dataclass
class Column:
    """Lines of text from the top down, as they are added."""

    left_top: FloatArray
    mm: float
    texts: list[Text] = field(default_factory=list)
    down_mm: float = 0.0

    def at(self, right_mm: float, down_mm: float) -> FloatArray:
        """(2,) a place in the column."""
        return self.left_top + self.mm * np.array([right_mm, -down_mm])

    def add(self, words: str, height_mm: float = SMALL_TEXT_MM, indent_mm: float = 0.0) -> None:
        """A paragraph, broken where the column ends."""
        for line in wrapped(words, COLUMN_MM - indent_mm, height_mm):
            self.down_mm += height_mm + LINE_MM - SMALL_TEXT_MM
            at = self.at(indent_mm, self.down_mm)
            self.texts.append(Text("notes", line, at, height_mm * self.mm, centred=False))

    def skip(self) -> None:
        """The space between two paragraphs."""
        self.down_mm += PARAGRAPH_MM


def notes(
    plan: FloorPlan,
    layers: Set[Layer],
    others: Sequence[PlanDimension],
    missing: Sequence[str],
    scale: str,
    left_top: FloatArray,
    mm: float,
) -> tuple[list[Text], list[Line], list[Area | Line]]:
    """Texts, scale bar and samples of the ``layers`` in use.

    ``others``: dimensions without a dimension line; ``missing``: labels without a place; ``scale``: ``1:50``, or
    nothing; ``left_top`` is the column's corner, ``mm`` of paper in world units.
    """
    column = Column(left_top, mm)
    column.add("Floor plan", TITLE_MM)
    column.add(_scale_text(plan.metric, scale))
    column.skip()
    bar, words = _bar(plan.metric, column)
    column.skip()
    column.add("North is not known.")
    for room in plan.rooms:
        column.add(f"{room.name}: {', '.join(area_texts(room, plan.metric))}")
    for one in others:
        column.add(f"{one.kind} {' – '.join(one.names)}: {length_text(one.length, one.sigma, plan.metric)}")
    if missing:
        column.add(f"No room for: {'; '.join(missing)}")
    column.skip()
    samples: list[Area | Line] = []
    for layer, meaning in MEANINGS.items():
        if layer in layers:
            start = column.down_mm
            column.add(meaning.format(weak=WEAK[plan.metric]), indent_mm=SAMPLE_MM + 2.0)
            samples.append(_sample(layer, column, start + LINE_MM))
    column.skip()
    for note in _remarks(plan):
        column.add(note)
    return [*column.texts, words], bar, samples


def wrapped(words: str, width_mm: float, height_mm: float) -> list[str]:
    """The text in lines no wider than ``width_mm``; a single word may be."""
    lines = [""]
    for word in words.split(" "):
        longer = f"{lines[-1]} {word}".lstrip()
        if lines[-1] and text_width(longer, height_mm) > width_mm:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def _scale_text(metric: bool, scale: str) -> str:
    if not metric:
        return f"Scale not known. Unit: {unit(metric)}"
    return f"Unit: metre, scale {scale} on A4" if scale else "Unit: metre, too large for a usual scale on A4"


def _bar(metric: bool, column: Column) -> tuple[list[Line], Text]:
    mm = column.mm
    power = 10.0 ** np.floor(np.log10(BAR_MM * mm))
    length = float(power * max(step for step in (1, 2, 5) if step * power <= BAR_MM * mm))
    column.down_mm += LINE_MM
    start = column.at(0.0, column.down_mm)
    ticks = [start + np.array([x, 0.0]) for x in (0.0, length / 2, length)]
    lines = [Line("notes", np.stack([ticks[0], ticks[-1]]))]
    lines += [Line("notes", np.stack([tick, tick + np.array([0.0, TICK_MM * mm])])) for tick in ticks]
    words = f"{length:g} {'m' if metric else 'scene units'}"
    return lines, Text("notes", words, ticks[-1] + np.array([2.0 * mm, 0.0]), TEXT_MM * mm, centred=False)


def _sample(layer: Layer, column: Column, down_mm: float) -> Area | Line:
    """A piece of line, or of area, before the first line of its meaning."""
    middle = down_mm - SMALL_TEXT_MM / 2
    if layer in ("floor", "sigma"):
        top, low = middle - SAMPLE_HEIGHT_MM / 2, middle + SAMPLE_HEIGHT_MM / 2
        corners = [column.at(x, y) for x, y in ((0.0, top), (SAMPLE_MM, top), (SAMPLE_MM, low), (0.0, low))]
        return Area(layer, (np.stack(corners),))
    return Line(layer, np.stack([column.at(0.0, middle), column.at(SAMPLE_MM, middle)]))


def _remarks(plan: FloorPlan) -> list[str]:
    remarks = [MEANING]
    if any(one.accuracy_level for one in plan.walls):
        remarks.append("LOA: level of accuracy of a wall's place at 95 % (USIBD).")
    if any(one.label == "door" for one in plan.openings):
        remarks.append("Which way a door opens is not known, and not drawn.")
    if plan.level != "floor":
        remarks.append(f"No floor: level by {plan.level}, at the lowest point that was drawn.")
    return remarks
