"""PLY: one mesh of what was seen, a colour per face by label, σ per vertex."""

from __future__ import annotations

from pathlib import Path

from gtlayout.export import unit
from gtlayout.io.files import write_atomic
from gtlayout.layout import Layout, as_trimesh
from gtlayout.scene import Scene


def write(path: Path, _scene: Scene, layout: Layout) -> None:
    """Write ``ply_bytes``. Raises GtlayoutError when the disk does not take them."""
    write_atomic(path, ply_bytes(layout))


def ply_bytes(layout: Layout) -> bytes:
    """The mesh as binary PLY. One mesh cannot keep apart what is inferred: that is left out, and a comment says so."""
    from trimesh.exchange.ply import export_ply

    content = bytes(export_ply(as_trimesh(layout), encoding="binary"))
    # Comments stand after the line that names the format (Turk, The PLY Polygon File Format); trimesh writes none.
    magic, format_line, rest = content.split(b"\n", 2)
    comments = [f"comment unit: {unit(layout.metric)}".encode()]
    if layout.inferred:
        comments.append(b"comment inferred: not in this file")
    return b"\n".join([magic, format_line, *comments, rest])
