"""Floor plan as DXF: one layer a class, in metres, or without unit where the scene has none."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gtlayout.export import unit
from gtlayout.export.floor_plan import FloorPlan, floor_plan
from gtlayout.export.font_cache import without_font_cache
from gtlayout.export.plan_drawing import draw
from gtlayout.export.plan_measures import ABOVE_MM
from gtlayout.export.plan_shapes import STYLES, Area, Drawing, Layer, Line, Measure, directions
from gtlayout.io.files import write_atomic
from gtlayout.layout import Layout
from gtlayout.scene import Scene

with without_font_cache():
    import ezdxf
    from ezdxf.document import Drawing as Document
    from ezdxf.enums import TextEntityAlignment
    from ezdxf.layouts import Modelspace

METRES, UNITLESS = 6, 0
"""$INSUNITS (Autodesk, DXF reference, HEADER section)."""
TEXT_STYLE = "LiberationSans"
BY_LAYER = 256
TRANSPARENCY = 0.7
LINEWEIGHTS = (13, 15, 18, 20, 25, 30, 35, 40, 50, 53, 60, 70)
COLORS: dict[Layer, int] = {
    "floor": 31,
    "sigma": 151,
    "slanted": 193,
    "open": 43,
    "inferred": 94,
    "walls": 7,
    "weak_walls": 253,
    "doors": 12,
    "windows": 122,
    "dimensions": 8,
    "labels": 8,
    "notes": 8,
}
"""AutoCAD colour indices (7 is black on white, white on black)."""


def write(path: Path, scene: Scene, layout: Layout) -> None:
    """Write the floor plan. Raises GtlayoutError when the layout has none, or the disk does not take it.

    Walls are LWPOLYLINEs in plan coordinates; the custom properties say where the plan lies in the scene's world:
    X = plan_origin + x plan_x + y plan_y.
    """
    plan = floor_plan(scene, layout)
    stream = io.StringIO()
    with _fixed_dates():
        _document(plan, draw(plan)).write(stream)
    write_atomic(path, stream.getvalue())


def _document(plan: FloorPlan, drawing: Drawing) -> Document:
    doc = ezdxf.new("R2010", setup=True)  # text styles and a dimension style; every CAD program reads R2010
    doc.header["$INSUNITS"] = METRES if plan.metric else UNITLESS
    doc.header["$MEASUREMENT"] = 1
    doc.header["$LWDISPLAY"] = 1
    for name, vector in zip(("plan_origin", "plan_x", "plan_y"), (plan.frame.origin, *plan.frame.axes), strict=True):
        doc.header.custom_vars.append(name, " ".join(repr(float(number)) for number in vector))
    doc.header.custom_vars.append("unit", unit(plan.metric))
    mm = 1.0 / drawing.mm_per_unit
    looks = {layer: _look(doc, layer, mm) for layer in STYLES}
    for layer, look in looks.items():
        doc.layers.add(layer.upper(), **look)
    msp = doc.modelspace()
    shapes: tuple[Area | Line, ...] = (*drawing.areas, *drawing.lines)
    for shape in shapes:
        _add(msp, shape, {"layer": shape.layer.upper()})
    for sample in drawing.legend:
        # Not on the layer itself, which holds the room and nothing else.
        _add(msp, sample, {"layer": "NOTES", **looks[sample.layer]})
    for text in drawing.texts:
        msp.add_text(
            text.text,
            height=text.height,
            rotation=text.angle_deg,
            dxfattribs={"layer": text.layer.upper(), "style": TEXT_STYLE},
        ).set_placement(text.start.tolist(), align=TextEntityAlignment.LEFT)
    for measure in drawing.measures:
        _add_dimension(msp, measure, mm)
    # In a fixed order: ezdxf takes them from a set, whose order differs from process to process.
    doc.classes.add_required_classes(doc.dxfversion)
    doc.classes.classes = dict(sorted(doc.classes.classes.items()))
    return doc


def _look(doc: Document, layer: Layer, mm: float) -> dict[str, Any]:
    """Colour, line weight and type of a layer; ``mm`` of paper in the drawing's unit."""
    style = STYLES[layer]
    linetype = "CONTINUOUS"
    if style.dashes_mm:
        dash, space = (length * mm for length in style.dashes_mm)
        linetype = f"GTLAYOUT_{layer.upper()}"
        doc.linetypes.add(linetype, [dash + space, dash, -space], description=layer.capitalize())
    return {"color": COLORS[layer], "lineweight": _nearest_lineweight(style.width_mm), "linetype": linetype}


def _add(msp: Modelspace, shape: Area | Line, attributes: dict[str, Any]) -> None:
    if isinstance(shape, Line):
        msp.add_lwpolyline(shape.points.tolist(), close=shape.closed, dxfattribs=attributes)
        return
    hatch = msp.add_hatch(color=attributes.get("color", BY_LAYER), dxfattribs={"layer": attributes["layer"]})
    hatch.transparency = TRANSPARENCY
    for ring in shape.rings:
        hatch.paths.add_polyline_path(ring.tolist(), is_closed=True)


def _add_dimension(msp: Modelspace, measure: Measure, mm: float) -> None:
    along = measure.ends[1] - measure.ends[0]
    # Points in the text's direction put the text above the line.
    forward = along @ directions(measure.text.angle_deg)[0] > 0
    first, second = measure.origins if forward else measure.origins[::-1]
    tick, height = measure.tick, measure.text.height
    sizes = {"dimtxt": height, "dimtsz": tick, "dimgap": ABOVE_MM * mm, "dimexo": 2 * tick, "dimexe": tick}
    colors = dict.fromkeys(("dimclrd", "dimclre", "dimclrt"), COLORS["dimensions"])
    msp.add_linear_dim(
        base=measure.ends[0].tolist(),
        p1=first.tolist(),
        p2=second.tolist(),
        angle=measure.text.angle_deg,
        text=measure.text.text,
        override={**sizes, **colors, "dimtad": 1, "dimtxsty": TEXT_STYLE, "dimscale": 1.0},
        dxfattribs={"layer": "DIMENSIONS"},
    ).render()


def _nearest_lineweight(width_mm: float) -> int:
    """1/100 mm, of those that DXF knows."""
    return min(LINEWEIGHTS, key=lambda weight: abs(weight - 100 * width_mm))


@contextmanager
def _fixed_dates() -> Iterator[None]:
    """The same bytes for the same plan: otherwise ezdxf writes today's date and random identifiers."""
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
