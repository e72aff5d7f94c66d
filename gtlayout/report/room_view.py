"""The room in 3D as data for the page: one mesh per instance, z up, with σ at every vertex."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh

from gtlayout.colors import instance_colors, sigma_colors
from gtlayout.geometry.raster import rings_of
from gtlayout.geometry.strip import sigma_along_normal
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene

SIGMA_STEP_SHARE = 0.06
"""Longest edge of the triangles that σ is drawn with, as a share of the mesh's size: σ is not linear on a plane."""
_OUTLINE_LIFT = 0.05
"""Of that edge."""
_SCALE_STEPS = 16
"""Colours that the scale of σ is made of; the browser interpolates."""
_MARGIN_SHARE = 0.01
"""Room round everything, as a share of the longest side."""


def room_view(
    scene: Scene, layout: Layout, sigma_full: float, reliable: Sequence[bool] | None = None
) -> dict[str, Any]:
    """Meshes, outlines, camera path and dimensions, turned so that z is up and the largest wall runs along x.

    Lengths are in world units; ``sigma_full`` is the end of the scale of σ. The view holds the instances that are
    ``reliable``, all when not given or none is; the others are faded, and cut off where they reach beyond.
    """
    reliable = reliable or [True] * len(layout.instances)
    turn = upright(scene, layout)
    step = SIGMA_STEP_SHARE * float(np.linalg.norm(np.ptp(layout.triangles.vertices, axis=0)))
    instances = []
    for i, (instance, plane, extent) in enumerate(zip(layout.instances, layout.planes, layout.extents, strict=True)):
        faces = layout.triangles.faces[layout.triangles.face_instance == i]
        if len(faces) == 0:
            continue
        used, renumbered = np.unique(faces, return_inverse=True)
        fine, fine_faces = trimesh.remesh.subdivide_to_size(
            layout.triangles.vertices[used], renumbered.reshape(-1, 3), step, max_iter=20
        )
        # In front of the mesh, or they would not be seen whole.
        lifted = _OUTLINE_LIFT * step * plane.normal
        outline = [
            (extent.frame.to_world(np.vstack([ring, ring[:1]])) + lifted) @ turn.T for ring in rings_of(extent.region)
        ]
        instances.append(
            {
                "name": instance.name,
                "color": instance_colors(i).tolist(),
                "vertices": _columns(fine @ turn.T),
                "faces": np.asarray(fine_faces).T.tolist(),
                "sigma": _rounded(sigma_along_normal(plane, extent, fine)),
                "outline": _broken_lines(outline),
                "normal": _rounded(turn @ plane.normal),
                "d": float(plane.d),
                "reliable": bool(reliable[i]),
            }
        )
    fitted = np.isin(layout.triangles.face_instance, np.nonzero(np.array(reliable))[0])
    faces = layout.triangles.faces[fitted] if fitted.any() else layout.triangles.faces
    room = layout.triangles.vertices[np.unique(faces)] @ turn.T
    path = np.array([frame.camera.center_world for frame in scene.frames]) @ turn.T
    everything = np.vstack([room, path])
    # plotly cuts off what lies outside, and a floor just at the border here and there.
    margin = _MARGIN_SHARE * np.ptp(everything, axis=0).max()
    low, high = everything.min(axis=0) - margin, everything.max(axis=0) + margin
    return {
        "instances": instances,
        "path": _columns(path),
        "dimensions": [
            {"ends": _columns(one.ends_world @ turn.T), "length": one.length, "sigma": _rounded(np.array(one.sigma))}
            for one in layout.dimensions
            if np.isfinite(one.length)
        ],
        "low": _rounded(low),
        "high": _rounded(high),
        "eye": _rounded(_eye(scene, turn)),
        "sigma_full": sigma_full,
        "sigma_scale": [
            f"rgb({red},{green},{blue})" for red, green, blue in sigma_colors(np.linspace(0, 1, _SCALE_STEPS)).tolist()
        ],
        "metric": layout.metric,
    }


def upright(scene: Scene, layout: Layout) -> FloatArray:
    """(3, 3) rotation of the world after which z is up and the largest wall faces along y.

    Up is the floor's normal, else the ceiling's turned round, else the cameras' mean up.
    """
    placed = [
        (instance.label, plane.normal, extent.region.area)
        for instance, plane, extent in zip(layout.instances, layout.planes, layout.extents, strict=True)
        if plane.observable
    ]
    ups = [normal for label, normal, _ in placed if label == "floor"]
    ups += [-normal for label, normal, _ in placed if label == "ceiling"]
    z = _unit(ups[0] if ups else -np.mean([frame.camera.R_cam_from_world[1] for frame in scene.frames], axis=0))
    walls = sorted((area, normal.tolist()) for label, normal, area in placed if label == "wall")
    ahead = np.array(walls[-1][1]) if walls else np.eye(3)[np.argmin(np.abs(z))]
    y = _unit(ahead - (ahead @ z) * z)
    return np.stack([np.cross(y, z), y, z])


def _eye(scene: Scene, turn: FloatArray) -> FloatArray:
    """(3,) the direction to look at the room from first, from its middle: behind and above the cameras."""
    forward = turn @ np.mean([frame.camera.R_cam_from_world[2] for frame in scene.frames], axis=0)
    back = -forward * (1.0, 1.0, 0.0)
    return _unit(back / max(float(np.linalg.norm(back)), 1e-9) + (0.35, 0.0, 0.9))


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12), dtype=np.float64)


def _broken_lines(lines: Sequence[FloatArray]) -> list[list[float | None]]:
    """Polylines (N, 3) as the x, y and z of one line that is broken between them."""
    columns: list[list[float | None]] = [[], [], []]
    for line in lines:
        for column, values in zip(columns, _columns(line), strict=True):
            column += [*values, None]
    return columns


def _columns(points: FloatArray) -> list[list[float]]:
    """(N, 3) as the lists x, y and z that plotly takes."""
    return [_rounded(column) for column in points.T]


def _rounded(values: FloatArray) -> Any:
    """Five digits: a tenth of a millimetre in a room."""
    return np.vectorize(lambda value: float(f"{value:.5g}") if np.isfinite(value) else None, otypes=[object])(
        values
    ).tolist()
