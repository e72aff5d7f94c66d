"""Meshes for the rerun viewer: plain ones, and the uncertainty of each."""

from __future__ import annotations

import numpy as np
import rerun as rr
import trimesh

from gtlayout.colors import Colors, sigma_colors, sigma_full
from gtlayout.figures import with_sigma
from gtlayout.geometry.depth import median_depth
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, IntArray, Scene

SIGMA_STEP_SHARE = 0.05
"""Longest edge of the triangles that σ is drawn with, as a share of the mesh's size: σ is not linear on a plane."""
SHEET_OPACITY = 110
"""Of 255: the mesh shows through the sheets in front of it."""
LABEL_AT = 0.2
"""Where along its line a dimension is written."""
_DIMENSION = (200, 30, 120)
"""Readable on light and dark."""


def mesh_of(vertices: FloatArray, faces: IntArray, colors: Colors, opacity: int = 255) -> rr.Mesh3D:
    """One mesh, in one colour (3,) or one per vertex (N, 3). It is seen from the room's inside only, so that a view
    from outside looks into the room.
    """
    single = colors if colors.ndim == 1 else np.full(3, 255, dtype=np.uint8)
    return rr.Mesh3D(
        vertex_positions=vertices,
        triangle_indices=faces,
        albedo_factor=np.append(single, np.uint8(opacity)),
        vertex_colors=None if colors.ndim == 1 else colors,
        face_rendering=rr.components.MeshFaceRendering.Front,
    )


def log_uncertainty(recording: rr.RecordingStream, scene: Scene, layout: Layout) -> None:
    """Each instance coloured by its own σ along its normal, translucent copies of it one σ to either side, and the
    dimensions.
    """
    mesh = layout.triangles
    full = sigma_full(layout.metric, median_depth(scene, layout.instances, layout.planes))
    for index, (instance, plane) in enumerate(zip(layout.instances, layout.planes, strict=True)):
        faces = mesh.faces[mesh.face_instance == index]
        if not len(faces):
            continue
        step = SIGMA_STEP_SHARE * float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
        vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, faces, step, max_iter=20)
        sigma = plane.sigma_offset(vertices)
        colors = sigma_colors(sigma / full)
        recording.log(f"world/uncertainty/{instance.name}", mesh_of(vertices, faces, colors), static=True)
        if not np.isfinite(sigma).all():
            continue  # it may be anywhere
        for side, sign in (("towards", 1.0), ("away", -1.0)):
            sheet = mesh_of(vertices + sign * sigma[:, None] * plane.normal, faces, colors, SHEET_OPACITY)
            recording.log(f"world/sheets/{side}/{instance.name}", sheet, static=True)
    unit = " m" if layout.metric else " units"
    ends = np.array([dimension.ends_world for dimension in layout.dimensions]).reshape(-1, 2, 3)
    recording.log("world/dimensions", rr.LineStrips3D(ends, colors=_DIMENSION, radii=-1.5), static=True)
    # Not at their middles, where those of a room cross.
    labels = rr.Points3D(
        (1 - LABEL_AT) * ends[:, 0] + LABEL_AT * ends[:, 1],
        labels=[with_sigma(one.length, one.sigma, 3, unit) for one in layout.dimensions],
        colors=_DIMENSION,
        radii=-2.0,
    )
    recording.log("world/dimensions/labels", labels, static=True)
