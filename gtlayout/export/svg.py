"""Floor plan as SVG: millimetres of paper, so that it prints to scale; names and layers are classes and titles."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from gtlayout.export import unit
from gtlayout.export.floor_plan import floor_plan
from gtlayout.export.helvetica import CAPITALS
from gtlayout.export.plan_drawing import MARGIN_MM, draw
from gtlayout.export.plan_shapes import STYLES, Area, Drawing, Line, Style, Text
from gtlayout.io.files import write_atomic
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene

Page = Callable[[FloatArray], FloatArray]
FONT = 'Arial, Helvetica, "Liberation Sans", sans-serif'


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
        f"<style>{_style_sheet()}</style>",
        f'<rect width="{width:.2f}" height="{height:.2f}" fill="#fff"/>',
    ]
    shapes: tuple[Area | Line, ...] = (*drawing.areas, *drawing.lines)
    parts += [_shape(one, page) for one in shapes]
    parts += [
        f'<polyline class="dimensions" points="{_numbers(page(points))}"/>'
        for measure in drawing.measures
        for points in measure.lines
    ]
    texts = (*drawing.texts, *(measure.text for measure in drawing.measures))
    parts += [_text(one, page(one.start[None])[0], drawing.mm_per_unit) for one in texts]
    legend = "\n".join(_shape(one, page) for one in drawing.legend)
    return "\n".join([*parts, f'<g class="legend">\n{legend}\n</g>', "</svg>", ""])


def _style_sheet() -> str:
    """All of it under one class: a page that takes the plan in keeps its own."""
    rules = ["polygon, .floor-plan polyline, .floor-plan path { fill: none; stroke-linecap: butt }"]
    rules += [f".{layer} {{ {_rule(style)} }}" for layer, style in STYLES.items()]
    rules.append(f".text {{ font-family: {FONT}; stroke: none }}")
    rules += [f".text.{layer} {{ fill: {STYLES[layer].color} }}" for layer in ("dimensions", "labels", "notes")]
    return "\n" + "\n".join(f".floor-plan {rule}" for rule in rules)


def _rule(style: Style) -> str:
    if not style.width_mm:
        return f"fill: {style.color}"
    dashes = f"; stroke-dasharray: {' '.join(f'{one:g}' for one in style.dashes_mm)}" if style.dashes_mm else ""
    return f"stroke: {style.color}; stroke-width: {style.width_mm:g}{dashes}"


def _shape(shape: Area | Line, page: Page) -> str:
    # What a browser shows when the pointer rests on it.
    title = f"<title>{escape(shape.name)}</title>" if shape.name else ""
    if isinstance(shape, Area):
        outline = " ".join(f"M {_numbers(page(ring))} Z" for ring in shape.rings)
        return f'<path class="{shape.layer}" fill-rule="evenodd" d="{outline}">{title}</path>'
    tag = "polygon" if shape.closed else "polyline"
    return f'<{tag} class="{shape.layer}" points="{_numbers(page(shape.points))}">{title}</{tag}>'


def _text(text: Text, start_mm: FloatArray, mm_per_unit: float) -> str:
    """As wide as in Helvetica, whatever face the reader has: what does not overlap here does not overlap there."""
    x, y = start_mm
    angle_deg = round(-text.angle_deg, 3)
    turned = f" rotate({angle_deg:.3f})" if angle_deg else ""
    return (
        f'<text class="text {text.layer}" transform="translate({x:.3f} {y:.3f}){turned}" '
        f'font-size="{text.height * mm_per_unit / CAPITALS:.3f}" textLength="{text.width * mm_per_unit:.3f}" '
        f'lengthAdjust="spacingAndGlyphs">{escape(text.text)}</text>'
    )


def _numbers(points: FloatArray) -> str:
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in points)
