"""A floor plan as lines, arcs and texts on named layers: what the SVG and the DXF file both draw.

Positions are plan coordinates in world units. Sizes of texts and signs are millimetres of paper, which the plan's scale
turns into world units: printed at that scale, a text is as large as in any other plan.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely

from gtlayout.export import unit
from gtlayout.export.floor_plan import BAND_SIGMAS, FloorPlan, Footprint, PlanDimension
from gtlayout.export.plan_labels import SMALL_TEXT_MM, TEXT_MM, Text, labels
from gtlayout.figures import is_known, with_sigma
from gtlayout.scene import FloatArray

Layer = Literal["floor", "sigma", "slanted", "walls", "doors", "windows", "dimensions", "labels", "notes"]
PAPER_MM = (240.0, 140.0)
"""What the plan itself may take of an A4 page in landscape; labels, dimensions and notes stand around it."""
SCALES = (10, 20, 25, 50, 100, 200, 500, 1000)
DIMENSION_MM, NEXT_DIMENSION_MM = 6.5, 7.0
"""Distances of dimension lines: from everything, and from one another."""
WINDOW_MM, TICK_MM, NOTES_MM, LINE_MM = 0.8, 1.0, 12.0, 4.5


@dataclass(frozen=True)
class Area:
    """What rings bound, without outline; holes are rings within others."""

    layer: Layer
    rings: tuple[FloatArray, ...]
    """(N, 2) each, the first point not repeated."""
    name: str
    """The instance it belongs to."""


@dataclass(frozen=True)
class Line:
    """A polyline."""

    layer: Layer
    points: FloatArray
    """(N, 2)."""
    name: str = ""
    """The instance it belongs to."""
    closed: bool = False


@dataclass(frozen=True)
class Arc:
    """Counter-clockwise about a centre."""

    layer: Layer
    center: FloatArray
    radius: float
    start_deg: float
    end_deg: float


@dataclass(frozen=True)
class Measure:
    """A dimension line with its text above and extension lines from the walls."""

    text: str
    ends: FloatArray
    """(2, 2) of the dimension line."""
    origins: FloatArray
    """(2, 2) on the walls, where the extension lines begin."""
    height: float


@dataclass(frozen=True)
class Drawing:
    """A plan, drawn."""

    mm_per_unit: float
    """Millimetres of paper for a world unit."""
    scale: str
    """In words: ``1:50``; a scene without metres has none."""
    areas: tuple[Area, ...]
    lines: tuple[Line, ...]
    arcs: tuple[Arc, ...]
    texts: tuple[Text, ...]
    measures: tuple[Measure, ...]
    bounds: FloatArray
    """(2, 2) lowest and highest coordinates, all texts included."""


def draw(plan: FloorPlan) -> Drawing:
    """Draw a plan at the largest usual scale that fits the paper."""
    mm_per_unit, scale = _scale(plan)
    mm = 1.0 / mm_per_unit
    areas = [Area("floor", tuple(_rings(one.region)), one.name) for one in plan.outlines if one.label == "floor"]
    areas += [Area("sigma", (wall.band,), wall.name) for wall in plan.walls if len(wall.band)]
    slanted = [one for one in plan.outlines if one.label != "floor"]
    lines = [Line("slanted", ring, one.name, closed=True) for one in slanted for ring in _rings(one.region)]
    lines += [Line("walls", wall.at(part), wall.name) for wall in plan.walls for part in wall.drawn]
    arcs = []
    for opening in plan.openings:
        signs, swing = _door(plan, opening) if opening.label == "door" else _window(opening, mm)
        lines += signs
        arcs += swing
    texts = labels(plan, mm)
    corners = np.concatenate([plan.bounds, *(shapely.get_coordinates(text.box) for text in texts)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    measures = _measures(plan, low, high, mm)
    for measure in measures:
        low = np.minimum(low, measure.ends.min(axis=0) - LINE_MM * mm)
        high = np.maximum(high, measure.ends.max(axis=0) + LINE_MM * mm)
    notes, bar = _notes(plan, scale, low, mm)
    lines += bar
    texts += notes
    low = np.minimum(low, np.array([notes[-1].at[0], notes[-1].at[1] - LINE_MM * mm]))
    high[0] = max(high[0], *(one.box.bounds[2] for one in notes))
    return Drawing(
        mm_per_unit,
        scale,
        tuple(areas),
        tuple(lines),
        tuple(arcs),
        tuple(texts),
        tuple(measures),
        np.stack([low, high]),
    )


def length_text(length: float, sigma: float, metric: bool) -> str:
    """``3.94 ± 0.02 m``: two digits of σ, no finer than millimetres."""
    known = is_known(sigma, length) and sigma > 0
    digits = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 3 if metric else 9)) if known else 3
    return with_sigma(length, sigma, digits, " m" if metric else " units")


def _scale(plan: FloorPlan) -> tuple[float, str]:
    span = np.maximum(np.ptp(plan.bounds, axis=0), 1e-9 * max(1.0, float(np.abs(plan.bounds).max())))
    fitting = float(np.min(np.array(PAPER_MM) / span))
    for scale in SCALES if plan.metric else ():
        if 1000.0 / scale <= fitting:
            return 1000.0 / scale, f"1:{scale}"
    return fitting, ""


def _rings(region: shapely.MultiPolygon) -> list[FloatArray]:
    return [shapely.get_coordinates(ring)[:-1] for part in region.geoms for ring in (part.exterior, *part.interiors)]


def _door(plan: FloorPlan, door: Footprint) -> tuple[list[Line], list[Arc]]:
    """The leaf, open, and the way it swings: a symbol, because it is not known which way the door opens.

    It hangs at the end that is nearer to a corner and opens into the room.
    """
    ends = [end for wall in plan.walls for end in wall.ends]
    hinge = min((0, 1), key=lambda e: min((float(np.linalg.norm(door.ends[e] - end)) for end in ends), default=0.0))
    pivot, latch = door.ends[hinge], door.ends[1 - hinge]
    leaf = pivot + door.length * door.inside
    angles = [float(np.rad2deg(np.arctan2(*(point - pivot)[::-1]))) for point in (leaf, latch)]
    # The quarter from one to the other, whichever way round.
    start, end = angles if (angles[1] - angles[0]) % 360 < 180 else angles[::-1]
    return [Line("doors", np.stack([pivot, leaf]), door.name)], [
        Arc("doors", pivot, door.length, start % 360, end % 360)
    ]


def _window(window: Footprint, mm: float) -> tuple[list[Line], list[Arc]]:
    """A double line between two short ones."""
    aside = WINDOW_MM * mm * window.inside
    panes = [window.ends + aside, window.ends - aside]
    caps = [np.stack([end + aside, end - aside]) for end in window.ends]
    return [Line("windows", points, window.name) for points in (*panes, *caps)], []


def _measures(plan: FloorPlan, low: FloatArray, high: FloatArray, mm: float) -> list[Measure]:
    """Dimension lines beside the plan: those across the page below it, the others to its left, the shortest nearest."""
    ends_of = {wall.name: wall.ends for wall in plan.walls}
    measures: list[Measure] = []
    rows = {0: 0, 1: 0}
    for one in sorted(plan.dimensions, key=lambda one: one.length):
        if one.kind != "width" or not ends_of.keys() >= set(one.names):
            continue
        across = one.ends[1] - one.ends[0]
        across = across / np.linalg.norm(across)
        side = int(abs(across[0]) >= abs(across[1]))  # the axis along which the line moves out
        outward = np.array([-across[1], across[0]])
        outward = outward if outward[side] < 0 else -outward
        out = max(float((corner - one.ends.mean(axis=0)) @ outward) for corner in _box(low, high))
        line = one.ends + (out + (DIMENSION_MM + rows[side] * NEXT_DIMENSION_MM) * mm) * outward
        rows[side] += 1
        origins = np.stack([max(ends_of[name], key=lambda end: float(end @ outward)) for name in one.names])
        measures.append(Measure(length_text(one.length, one.sigma, plan.metric), line, origins, TEXT_MM * mm))
    return measures


def _notes(plan: FloorPlan, scale: str, low: FloatArray, mm: float) -> tuple[list[Text], list[Line]]:
    """The scale bar and, below it, what the drawing does not show: lower left corner at ``low``, downwards."""
    about = 40.0 * mm
    power = 10.0 ** np.floor(np.log10(about))
    bar = float(power * max(step for step in (1, 2, 5) if step * power <= about))
    start = low + np.array([0.0, -NOTES_MM * mm])
    ticks = [start + np.array([x, 0.0]) for x in (0.0, bar / 2, bar)]
    lines = [Line("notes", np.stack([ticks[0], ticks[-1]]))]
    lines += [Line("notes", np.stack([tick, tick + np.array([0.0, TICK_MM * mm])])) for tick in ticks]
    words = f"{bar:g} {unit(plan.metric)}" if plan.metric else f"{bar:g} scene units"
    notes = [
        f"height {' – '.join(one.names)}: {length_text(one.length, one.sigma, plan.metric)}" for one in _heights(plan)
    ]
    notes.append(f"Shaded: ± {BAND_SIGMAS:g} σ of each wall's place, at most half its length.")
    notes.append("Dimensions: ± 1 σ. Lengths without ± are as drawn. Which way a door opens is not known.")
    if plan.level != "floor":
        notes.append(f"No floor: level by {plan.level}, at the lowest point that was drawn.")
    notes.append(f"Unit: metre, scale {scale}" if scale else f"Unit: {unit(plan.metric)}")
    texts = [Text("notes", words, ticks[-1] + np.array([2.0 * mm, 0.0]), TEXT_MM * mm, centred=False)]
    for row, line in enumerate(notes, start=1):
        texts.append(
            Text("notes", line, start - np.array([0.0, row * LINE_MM * mm]), SMALL_TEXT_MM * mm, centred=False)
        )
    return texts, lines


def _heights(plan: FloorPlan) -> list[PlanDimension]:
    return [one for one in plan.dimensions if one.kind == "height"]


def _box(low: FloatArray, high: FloatArray) -> list[FloatArray]:
    return [np.array([x, y]) for x in (low[0], high[0]) for y in (low[1], high[1])]
