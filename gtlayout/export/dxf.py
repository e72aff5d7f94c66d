"""Floor plan as DXF: one layer a class, in metres, or without unit where the scene has none."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from gtlayout.export import unit
from gtlayout.export.floor_plan import FloorPlan, floor_plan
from gtlayout.export.font_cache import without_font_cache
from gtlayout.export.plan_drawing import TICK_MM, Drawing, Layer, Measure, draw
from gtlayout.export.plan_labels import upright
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
DASHES_MM = (2.0, 1.2)
LAYERS: dict[Layer, tuple[int, int]] = {
    "floor": (31, 13),
    "sigma": (151, 13),
    "slanted": (193, 25),
    "walls": (7, 70),
    "doors": (12, 25),
    "windows": (122, 25),
    "dimensions": (8, 18),
    "labels": (8, 18),
    "notes": (8, 25),
}
"""Of each layer its AutoCAD colour index (7 is black on white, white on black) and line weight, 1/100 mm."""


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
    dash, space = (length * mm for length in DASHES_MM)
    doc.linetypes.add("GTLAYOUT_DASHED", [dash + space, dash, -space], description="Slanted surfaces")
    for layer, (color, lineweight) in LAYERS.items():
        linetype = "GTLAYOUT_DASHED" if layer == "slanted" else "CONTINUOUS"
        doc.layers.add(layer.upper(), color=color, lineweight=lineweight, linetype=linetype)
    msp = doc.modelspace()
    for area in drawing.areas:
        hatch = msp.add_hatch(color=BY_LAYER, dxfattribs={"layer": area.layer.upper()})
        hatch.transparency = TRANSPARENCY
        for ring in area.rings:
            hatch.paths.add_polyline_path(ring.tolist(), is_closed=True)
    for line in drawing.lines:
        msp.add_lwpolyline(line.points.tolist(), close=line.closed, dxfattribs={"layer": line.layer.upper()})
    for arc in drawing.arcs:
        msp.add_arc(
            arc.center.tolist(), arc.radius, arc.start_deg, arc.end_deg, dxfattribs={"layer": arc.layer.upper()}
        )
    for text in drawing.texts:
        align = TextEntityAlignment.MIDDLE_CENTER if text.centred else TextEntityAlignment.LEFT
        msp.add_text(
            text.text,
            height=text.height,
            rotation=text.angle_deg,
            dxfattribs={"layer": text.layer.upper(), "style": TEXT_STYLE},
        ).set_placement(text.at.tolist(), align=align)
    for measure in drawing.measures:
        _add_dimension(msp, measure, mm)
    # In a fixed order: ezdxf takes them from a set, whose order differs from process to process.
    doc.classes.add_required_classes(doc.dxfversion)
    doc.classes.classes = dict(sorted(doc.classes.classes.items()))
    return doc


def _add_dimension(msp: Modelspace, measure: Measure, mm: float) -> None:
    along = measure.ends[1] - measure.ends[0]
    angle = float(np.rad2deg(np.arctan2(along[1], along[0])))
    # Points in the text's direction put the text above the line.
    readable = upright(angle)
    first, second = measure.origins if abs(readable - angle) < 90.0 else measure.origins[::-1]
    sizes = {"dimtxt": measure.height, "dimtsz": TICK_MM * mm, "dimgap": mm, "dimexo": 2 * mm, "dimexe": mm}
    colors = dict.fromkeys(("dimclrd", "dimclre", "dimclrt"), LAYERS["dimensions"][0])
    msp.add_linear_dim(
        base=measure.ends[0].tolist(),
        p1=first.tolist(),
        p2=second.tolist(),
        angle=readable,
        text=measure.text,
        override={**sizes, **colors, "dimtad": 1, "dimtxsty": TEXT_STYLE, "dimscale": 1.0},
        dxfattribs={"layer": "DIMENSIONS"},
    ).render()


@contextmanager
def _fixed_dates() -> Iterator[None]:
    """The same bytes for the same plan: otherwise ezdxf writes today's date and random identifiers."""
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
