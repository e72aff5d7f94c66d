"""Wavefront OBJ with its MTL: one named group and material per instance."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtlayout.colors import LABEL_COLORS
from gtlayout.errors import GtlayoutError
from gtlayout.export import unit
from gtlayout.export.inferred import INFERRED, INFERRED_COLOR, INFERRED_OPACITY, inferred_parts
from gtlayout.io.files import write_all_atomic
from gtlayout.layout import Layout
from gtlayout.scene import Scene


def write(path: Path, _scene: Scene, layout: Layout) -> None:
    """Write the mesh in the world frame and unit of the input cameras, and ``<name>.mtl`` beside it.

    Raises GtlayoutError when the disk does not take them.
    """
    materials = path.with_suffix(".mtl")
    if materials == path or any(sign.isspace() for sign in materials.name):
        # The line that names the materials ends names at blanks (Alias, Object Files, version 3.0).
        raise GtlayoutError(f"cannot write {path}: an OBJ file's name must not hold blanks nor end in .mtl")
    write_all_atomic({materials: _materials(layout), path: _obj(layout, materials.name)})


def _obj(layout: Layout, materials: str) -> str:
    mesh = layout.triangles
    lines = [f"# unit: {unit(layout.metric)}; frame: the world of the input cameras", f"mtllib {materials}"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    for i, instance in enumerate(layout.instances):
        faces = mesh.faces[mesh.face_instance == i] + 1
        if len(faces):
            # "o" as well: some programs split by groups, others by objects.
            lines += [f"o {instance.name}", f"g {instance.name}", f"usemtl {instance.name}"]
            lines += [f"f {a} {b} {c}" for a, b, c in faces.tolist()]
    count = len(mesh.vertices)
    for name, vertices, faces in inferred_parts(layout):
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        lines += [f"o {name}", f"g {name}", f"usemtl {INFERRED}"]
        lines += [f"f {a} {b} {c}" for a, b, c in (faces + count + 1).tolist()]
        count += len(vertices)
    return "\n".join([*lines, ""])


def _materials(layout: Layout) -> str:
    lines: list[str] = []
    materials = [(instance.name, LABEL_COLORS[instance.label], 1.0) for instance in layout.instances]
    if layout.inferred:
        materials.append((INFERRED, INFERRED_COLOR, INFERRED_OPACITY / 255))
    for name, color, opacity in materials:
        red, green, blue = np.array(color) / 255
        lines += [
            f"newmtl {name}",
            f"Kd {red:.4f} {green:.4f} {blue:.4f}",
            "Ka 0 0 0",
            "Ks 0 0 0",
            f"d {opacity:.4g}",
            "illum 1",
        ]
    return "\n".join([*lines, ""])
