"""Floor plan as PDF: one A4 page in landscape, to scale.

Written here, because a page of lines, areas and text in a face that every reader has takes fewer lines than a library
would take to be installed, and no date or random identifier gets in. Source: ISO 32000-1, sections 7.5 (file
structure), 8.5 (paths) and 9.4 (text).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtlayout.export import unit
from gtlayout.export.floor_plan import floor_plan
from gtlayout.export.helvetica import CAPITALS
from gtlayout.export.plan_drawing import PAGE_MM, draw
from gtlayout.export.plan_shapes import STYLES, Area, Drawing, Line, Text, directions
from gtlayout.io.files import write_atomic
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene

POINTS_PER_MM = 72.0 / 25.4


def write(path: Path, scene: Scene, layout: Layout) -> None:
    """Write the floor plan. Raises GtlayoutError when the layout has none, or the disk does not take it."""
    write_atomic(path, pdf_bytes(draw(floor_plan(scene, layout)), unit(layout.metric)))


def pdf_bytes(drawing: Drawing, unit_text: str) -> bytes:
    """The drawing in the middle of a page; ``unit_text`` is what the metadata say of the lengths' unit."""
    content = "\n".join(_content(drawing)).encode("ascii")
    width, height = (_number(size * POINTS_PER_MM) for size in PAGE_MM)
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width} {height}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>".encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
        f"<< /Title (Floor plan) /Subject {_string(f'Unit of lengths: {unit_text}')} >>".encode(),
    ]
    file = b"%PDF-1.4\n"
    places = []
    for number, body in enumerate(objects, start=1):
        places.append(len(file))
        file += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    table += b"".join(b"%010d 00000 n \n" % place for place in places)
    trailer = b"trailer\n<< /Size %d /Root 1 0 R /Info 6 0 R >>\n" % (len(objects) + 1)
    return file + table + trailer + b"startxref\n%d\n%%%%EOF\n" % len(file)


def _content(drawing: Drawing) -> list[str]:
    """The page's drawing commands."""
    scale = drawing.mm_per_unit * POINTS_PER_MM
    corner = np.array(PAGE_MM) / 2 * POINTS_PER_MM - drawing.bounds.mean(axis=0) * scale
    shapes: tuple[Area | Line, ...] = (*drawing.areas, *drawing.lines, *drawing.legend)
    shapes += tuple(Line("dimensions", points) for measure in drawing.measures for points in measure.lines)
    commands = []
    for shape in shapes:
        style = STYLES[shape.layer]
        color = " ".join(_number(int(style.color[k : k + 2], 16) / 255) for k in (1, 3, 5))
        if isinstance(shape, Area):
            commands += [f"{color} rg", *(_path(ring * scale + corner) + " h" for ring in shape.rings), "f*"]
        else:
            dashes = " ".join(_number(one * POINTS_PER_MM) for one in style.dashes_mm)
            commands += [f"{color} RG {_number(style.width_mm * POINTS_PER_MM)} w [{dashes}] 0 d"]
            commands += [f"{_path(shape.points * scale + corner)} {'s' if shape.closed else 'S'}"]
    for text in (*drawing.texts, *(measure.text for measure in drawing.measures)):
        commands.append(_text(text, text.start * scale + corner, text.height * scale))
    return commands


def _path(points: FloatArray) -> str:
    return " ".join(f"{_number(x)} {_number(y)} {'l' if k else 'm'}" for k, (x, y) in enumerate(points.tolist()))


def _text(text: Text, start: FloatArray, capitals: float) -> str:
    color = " ".join(_number(int(STYLES[text.layer].color[k : k + 2], 16) / 255) for k in (1, 3, 5))
    along, up = directions(text.angle_deg)
    matrix = " ".join(_number(value) for value in (*along, *up, *start))
    return f"{color} rg BT /F1 {_number(capitals / CAPITALS)} Tf {matrix} Tm {_string(text.text)} Tj ET"


def _string(text: str) -> str:
    """In the file's own encoding, as hexadecimal digits; what it lacks becomes a question mark."""
    return f"<{text.encode('cp1252', 'replace').hex()}>"


def _number(value: float) -> str:
    """Without an exponent, which PDF does not know, and without a negative zero."""
    return f"{value:.3f}" if abs(value) >= 0.0005 else "0"
