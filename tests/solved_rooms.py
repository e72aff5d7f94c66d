"""The box room as if it had been solved without error, from whatever was drawn of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import rooms

from gtlayout.config import Config
from gtlayout.extent.extents import compute_extents
from gtlayout.instances import Instance
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.planes.estimate import Estimate
from gtlayout.scene import Camera, Frame, Scene
from gtlayout.solution import Solution

CENTER = (2.0, 0.6, 1.25)
NARROW = rooms.level_camera(CENTER, focal=300.0, width=640, height=480)
WIDE = rooms.level_camera(CENTER, focal=200.0, width=640, height=480)
SEEN = rooms.BOX[:5]
"""Without the wall behind the cameras."""


def solved(
    drawn: Sequence[Camera],
    others: Sequence[Camera],
    surfaces: Sequence[rooms.Surface] = SEEN,
    sigma: float = 0.0,
    scene: Scene | None = None,
    instances: tuple[Instance, ...] | None = None,
) -> Solution:
    """As if solved without error: key frames by ``drawn``, then frames without drawings."""
    scene = scene or rooms.seen_from(drawn, surfaces)
    frames = (*scene.frames, *(Frame(f"x{k}.png", scene.root, camera) for k, camera in enumerate(others)))
    scene = replace(scene, frames=frames)
    instances = instances or rooms.instances_of(surfaces, len(scene.key_frames))
    planes = tuple(surface.plane for surface in surfaces)
    covariance = sigma**2 * np.diag(np.tile([0.0, 0.0, 0.0, 1.0], len(planes)))
    planes = tuple(replace(plane, covariance=covariance[:4, :4]) for plane in planes)
    extents = compute_extents(scene, instances, planes, (), Config().extent)
    layout = Layout(instances, planes, extents, build_mesh(instances, extents), metric=True)
    nothing = cast(Any, None)
    estimate = Estimate(planes, covariance, nothing, nothing, nothing, {}, ())
    return Solution(scene, layout, nothing, nothing, nothing, (), estimate, {})
