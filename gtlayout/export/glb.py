"""GLB (binary glTF 2.0): one named node and material per instance, y up."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtlayout.colors import LABEL_COLORS
from gtlayout.export import unit
from gtlayout.export.inferred import INFERRED, INFERRED_COLOR, INFERRED_OPACITY, inferred_parts
from gtlayout.io.files import write_atomic
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene


def write(path: Path, _scene: Scene, layout: Layout) -> None:
    """Write ``glb_bytes``. Raises GtlayoutError when the disk does not take them."""
    write_atomic(path, glb_bytes(layout))


def glb_bytes(layout: Layout) -> bytes:
    """GLB with one named node and material per instance, y up: rotated so that the floor (or the ceiling) is level."""
    import trimesh

    mesh = layout.triangles
    turn = y_up(layout)
    scene = trimesh.Scene()
    for i, instance in enumerate(layout.instances):
        faces = mesh.faces[mesh.face_instance == i]
        if len(faces) == 0:
            continue
        used, renumbered = np.unique(faces, return_inverse=True)
        material = trimesh.visual.material.PBRMaterial(
            name=instance.name,
            baseColorFactor=[*LABEL_COLORS[instance.label], 255],
            metallicFactor=0.0,
            roughnessFactor=1.0,
            doubleSided=True,
        )
        scene.add_geometry(
            trimesh.Trimesh(
                mesh.vertices[used] @ turn.T,
                renumbered.reshape(-1, 3),
                visual=trimesh.visual.TextureVisuals(material=material),
                process=False,
            ),
            node_name=instance.name,
            geom_name=instance.name,
        )
    for name, vertices, faces in inferred_parts(layout):
        material = trimesh.visual.material.PBRMaterial(
            name=INFERRED,
            baseColorFactor=[*INFERRED_COLOR, INFERRED_OPACITY],
            metallicFactor=0.0,
            roughnessFactor=1.0,
            doubleSided=True,
            alphaMode="BLEND",
        )
        part = trimesh.Trimesh(
            vertices @ turn.T, faces, visual=trimesh.visual.TextureVisuals(material=material), process=False
        )
        scene.add_geometry(part, node_name=name, geom_name=name)
    if not scene.geometry:
        # glTF knows no empty scene in trimesh's writer.
        scene.add_geometry(trimesh.Trimesh(), geom_name="empty")
    # glTF's unit is the metre; extras are where a file may say more (glTF 2.0, 3.4 and 3.11).
    scene.metadata = {"metric": layout.metric, "unit": unit(layout.metric)}
    return bytes(trimesh.exchange.gltf.export_glb(scene))


def y_up(layout: Layout) -> FloatArray:
    """(3, 3) rotation that turns the floor's normal to +y; without a floor the ceiling's to −y; without either none."""
    from trimesh.geometry import align_vectors

    for label, sign in (("floor", 1.0), ("ceiling", -1.0)):
        for instance, plane in zip(layout.instances, layout.planes, strict=True):
            if instance.label == label and plane.observable:
                rotation: FloatArray = align_vectors(plane.normal, [0.0, sign, 0.0])[:3, :3]
                return rotation
    return np.eye(3)
