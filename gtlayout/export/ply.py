"""PLY: one mesh, a colour per face by label, σ per vertex."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from gtlayout.colors import LABEL_COLORS
from gtlayout.export import unit
from gtlayout.io.files import write_atomic
from gtlayout.layout import Layout
from gtlayout.mesh import vertex_sigma
from gtlayout.scene import Scene


def write(path: Path, _scene: Scene, layout: Layout) -> None:
    """Write ``ply_bytes``. Raises GtlayoutError when the disk does not take them."""
    write_atomic(path, ply_bytes(layout))


def ply_bytes(layout: Layout) -> bytes:
    """``surface`` as binary PLY."""
    content = bytes(trimesh.exchange.ply.export_ply(surface(layout), encoding="binary"))
    # Comments stand after the line that names the format (Turk, The PLY Polygon File Format); trimesh writes none.
    magic, format_line, rest = content.split(b"\n", 2)
    return b"\n".join([magic, format_line, f"comment unit: {unit(layout.metric)}".encode(), rest])


def surface(layout: Layout) -> trimesh.Trimesh:
    """The mesh in the world frame and unit of the input cameras: a colour per face by label, ``sigma`` per vertex."""
    mesh = layout.triangles
    colors = np.array([LABEL_COLORS[instance.label] for instance in layout.instances], dtype=np.uint8)
    made = trimesh.Trimesh(mesh.vertices, mesh.faces, face_colors=colors[mesh.face_instance], process=False)
    made.vertex_attributes["sigma"] = vertex_sigma(mesh, layout.planes).astype(np.float32)
    return made
