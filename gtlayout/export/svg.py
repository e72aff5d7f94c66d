"""Floor plan as SVG: millimetres of paper, so that it prints to scale; names and layers are classes and titles."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from gtlayout.export import unit
from gtlayout.export.floor_plan import floor_plan
from gtlayout.export.plan_drawing import TICK_MM, Arc, Area, Drawing, Line, Measure, draw
from gtlayout.export.plan_labels import TEXT_MM, Text
from gtlayout.io.files import write_atomic
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene

MARGIN_MM = 8.0
CAPITALS = 0.716
"""Height of capitals as a share of the font size: Arial's, and Helvetica's."""
STYLE = """\
.floor-plan polygon, .floor-plan polyline, .floor-plan path { fill: none; stroke-linecap: round }
.floor-plan .floor { fill: #f4eee6 }
.floor-plan .sigma { fill: #5696c9; fill-opacity: .35 }
.floor-plan .slanted { stroke: #7a55a0; stroke-width: .25; stroke-dasharray: 2 1.2 }
.floor-plan .walls { stroke: #222; stroke-width: .7 }
.floor-plan .doors { stroke: #b0483f; stroke-width: .25 }
.floor-plan .windows { stroke: #2a8f86; stroke-width: .25 }
.floor-plan .dimensions { stroke: #555; stroke-width: .18 }
.floor-plan .notes { stroke: #333; stroke-width: .25 }
.floor-plan .text { font-family: Arial, Helvetica, "Liberation Sans", sans-serif; fill: #333; stroke: none }
.floor-plan .labels { fill: #666 }"""
"""All of it under one class: a page that takes the plan in keeps its own."""


def write(path: Path, scene: Scene, layout: Layout) -> None:
    """Write the floor plan. Raises GtlayoutError when the layout has none, or the disk does not take it."""
    write_atomic(path, svg_text(draw(floor_plan(scene, layout)), unit(layout.metric)))


def svg_text(drawing: Drawing, unit_text: str) -> str:
    """The drawing as a page of its own size; ``unit_text`` is what its metadata say of the lengths' unit."""
    low, high = drawing.bounds
    width, height = (high - low) * drawing.mm_per_unit + 2 * MARGIN_MM

    def page(points: FloatArray) -> FloatArray:
        """(N, 2) plan → millimetres from the page's upper left corner."""
        return np.column_stack([points[:, 0] - low[0], high[1] - points[:, 1]]) * drawing.mm_per_unit + MARGIN_MM

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" height="{height:.2f}mm" '
        f'viewBox="0 0 {width:.2f} {height:.2f}" role="img" class="floor-plan">',
        f"<title>Floor plan</title><desc>Unit of lengths: {escape(unit_text)}</desc>",
        f"<style>{STYLE}</style>",
        f'<rect width="{width:.2f}" height="{height:.2f}" fill="#fff"/>',
    ]
    parts += [_area(one, [page(ring) for ring in one.rings]) for one in drawing.areas]
    parts += [_line(one, page(one.points)) for one in drawing.lines]
    parts += [_arc(one, page(_arc_ends(one)), one.radius * drawing.mm_per_unit) for one in drawing.arcs]
    for measure in drawing.measures:
        parts += _measure(measure, page(measure.ends), page(measure.origins))
    parts += [_text(one, page(one.at[None])[0], one.height * drawing.mm_per_unit) for one in drawing.texts]
    return "\n".join([*parts, "</svg>", ""])


def _area(area: Area, rings_mm: list[FloatArray]) -> str:
    outline = " ".join(f"M {_numbers(ring)} Z" for ring in rings_mm)
    return f'<path class="{area.layer}" fill-rule="evenodd" d="{outline}">{_title(area.name)}</path>'


def _line(line: Line, points_mm: FloatArray) -> str:
    tag = "polygon" if line.closed else "polyline"
    return f'<{tag} class="{line.layer}" points="{_numbers(points_mm)}">{_title(line.name)}</{tag}>'


def _title(name: str) -> str:
    """What a browser shows when the pointer rests on it."""
    return f"<title>{escape(name)}</title>" if name else ""


def _arc_ends(arc: Arc) -> FloatArray:
    angles = np.deg2rad([arc.start_deg, arc.end_deg])
    return arc.center + arc.radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _arc(arc: Arc, ends_mm: FloatArray, radius_mm: float) -> str:
    start, end = (_numbers(end[None]) for end in ends_mm)
    # The page's y is down: counter-clockwise in the plan is SVG's sweep 0.
    return f'<path class="{arc.layer}" d="M {start} A {radius_mm:.3f} {radius_mm:.3f} 0 0 0 {end}"/>'


def _measure(measure: Measure, ends_mm: FloatArray, origins_mm: FloatArray) -> list[str]:
    along = ends_mm[1] - ends_mm[0]
    if along[0] < -1e-9 or (abs(along[0]) <= 1e-9 and along[1] > 0):
        along = -along
    along /= max(float(np.linalg.norm(along)), 1e-9)
    above = np.array([along[1], -along[0]])
    tick = TICK_MM * (along + above)
    lines = [ends_mm, *(np.stack([end - tick, end + tick]) for end in ends_mm)]
    for end, origin in zip(ends_mm, origins_mm, strict=True):
        way = (end - origin) / max(float(np.linalg.norm(end - origin)), 1e-9)
        lines.append(np.stack([origin + 2 * TICK_MM * way, end + TICK_MM * way]))
    angle = float(np.rad2deg(np.arctan2(along[1], along[0])))
    return [f'<polyline class="dimensions" points="{_numbers(points)}"/>' for points in lines] + [
        _words(measure.text, ends_mm.mean(axis=0) + 1.2 * above, TEXT_MM, angle, "middle", "dimensions", raised=0.0)
    ]


def _text(text: Text, at_mm: FloatArray, height_mm: float) -> str:
    anchor = "middle" if text.centred else "start"
    return _words(text.text, at_mm, height_mm, -text.angle_deg, anchor, text.layer, raised=0.5 if text.centred else 0.0)


def _words(
    text: str, at_mm: FloatArray, height_mm: float, angle_deg: float, anchor: str, layer: str, raised: float
) -> str:
    """``raised``: how much of the capitals' height lies below the point."""
    x, y = at_mm
    return (
        f'<text class="text {layer}" transform="translate({x:.3f} {y:.3f}) rotate({angle_deg:.3f})" '
        f'y="{raised * height_mm:.3f}" font-size="{height_mm / CAPITALS:.3f}" text-anchor="{anchor}">'
        f"{escape(text)}</text>"
    )


def _numbers(points: FloatArray) -> str:
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in points)
