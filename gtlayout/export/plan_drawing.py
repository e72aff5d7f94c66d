"""A floor plan as lines and texts on named layers, to fit an A4 page: what SVG, PDF and DXF draw.

Sizes of texts and signs are millimetres of paper, which the plan's scale turns into world units: printed at that scale,
a text is as large as in any other plan.
"""

from __future__ import annotations

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.export.floor_plan import FloorPlan
from gtlayout.export.plan_labels import Free, labels
from gtlayout.export.plan_measures import extensions, measures, sides
from gtlayout.export.plan_notes import COLUMN_MM, GAP_MM, notes
from gtlayout.export.plan_shapes import Area, Drawing, Layer, Line, Text, rings
from gtlayout.export.plan_walls import Footprint
from gtlayout.scene import FloatArray

PAGE_MM = (297.0, 210.0)
"""A4 in landscape: plans lie along their longest wall."""
MARGIN_MM = 8.0
SCALES = (10, 20, 25, 50, 100, 200, 500, 1000)
SMALLER = 0.93
"""From one try to the next, where there is no usual scale."""
TRIES = 30
WINDOW_MM, JAMB_MM = 0.8, 1.4
"""Half the width of a window's sign, and of the short lines at both ends of an opening."""


def draw(plan: FloorPlan) -> Drawing:
    """Draw a plan at the largest usual scale at which it fits A4 with all its texts; without metres at any scale."""
    span = np.maximum(np.ptp(plan.bounds, axis=0), 1e-9 * max(1.0, float(np.abs(plan.bounds).max())))
    room_mm = np.array(PAGE_MM) - 2 * MARGIN_MM
    fitting = float(np.min((room_mm - [COLUMN_MM + GAP_MM, 0.0]) / span))
    usual = [(1000.0 / scale, f"1:{scale}") for scale in SCALES if plan.metric and 1000.0 / scale <= fitting]
    for mm_per_unit, scale in [*usual, *((fitting * SMALLER**k, "") for k in range(TRIES))]:
        drawing = draw_at(plan, mm_per_unit, scale)
        if (np.ptp(drawing.bounds, axis=0) * mm_per_unit <= room_mm).all():
            break
    return drawing


def draw_at(plan: FloorPlan, mm_per_unit: float, scale: str) -> Drawing:
    """Draw a plan with so many millimetres for a world unit; ``scale`` says so in words."""
    mm = 1.0 / mm_per_unit
    areas = [Area("floor", tuple(rings(one.region)), one.name) for one in plan.rooms]
    uncertain = [(wall.band, wall.name) for wall in plan.walls] + [(one.band, one.name) for one in plan.curves]
    areas += [Area("sigma", (band,), name) for band, name in uncertain if len(band)]
    lines = [Line("slanted", ring, one.name, closed=True) for one in plan.outlines for ring in rings(one.region)]
    for room in plan.rooms:
        lines += [Line("open", points, room.name) for points in room.open]
        lines += [Line("inferred", points, room.name) for points in room.inferred_outline]
    for wall in plan.walls:
        lines += [Line("weak_walls" if wall.weak else "walls", wall.at(part), wall.name) for part in wall.drawn]
    for one in plan.curves:
        lines += [Line("weak_walls" if one.weak else "walls", part, one.name) for part in one.drawn]
    lines += [
        Line("inferred", one.at(part), one.name) for one in (*plan.walls, *plan.openings) for part in one.inferred
    ]
    for opening in plan.openings:
        lines += _opening(opening, mm)
    found, others = sides(plan)
    obstacles = [*map(_shape, lines), *(LineString(wall.ends) for wall in plan.walls), *extensions(found, plan.bounds)]
    bands = [Polygon(band) for band, _ in uncertain if len(band)]
    texts, leads, missing = labels(plan, Free(obstacles, bands), mm)
    bounds = _around(
        [plan.bounds, *(shapely.get_coordinates(one.box) for one in texts), *(one.points for one in leads)]
    )
    drawn, covered = measures(found, bounds, plan.metric, mm)
    bounds = _around([bounds, *map(shapely.get_coordinates, covered)])
    left_top = np.array([bounds[1, 0] + GAP_MM * mm, bounds[1, 1]])
    layers = {one.layer for one in areas} | {one.layer for one in lines}
    words, bar, legend = notes(plan, layers, others, missing, scale, left_top, mm)
    return Drawing(
        mm_per_unit,
        tuple(areas),
        (*lines, *leads, *bar),
        (*texts, *words),
        tuple(drawn),
        tuple(legend),
        _around([bounds, *map(_corners, words)]),
    )


def _opening(one: Footprint, mm: float) -> list[Line]:
    """Jambs at both ends; between them a door's sill, or a window's two lines. A door's leaf is not known."""
    layer: Layer = "doors" if one.label == "door" else "windows"
    half = JAMB_MM * mm * one.inside
    parts = [np.stack([end + half, end - half]) for end in one.ends]
    aside = WINDOW_MM * mm * one.inside
    parts += [one.ends] if layer == "doors" else [one.ends + aside, one.ends - aside]
    return [Line(layer, points, one.name) for points in parts]


def _shape(line: Line) -> BaseGeometry:
    return shapely.LinearRing(line.points) if line.closed else LineString(line.points)


def _corners(text: Text) -> FloatArray:
    return shapely.get_coordinates(text.box)


def _around(points: list[FloatArray]) -> FloatArray:
    """(2, 2) lowest and highest coordinates of points, (N, 2) each."""
    every = np.concatenate(points)
    return np.stack([every.min(axis=0), every.max(axis=0)])
