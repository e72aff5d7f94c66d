"""Which way is up in a layout, and where its floor is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import shapely

from gtlayout.dimensions.facing import MAX_ANGLE_DEG
from gtlayout.errors import GtlayoutError
from gtlayout.instances import PlaneFrame
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Label, Scene

Level = Literal["floor", "ceiling", "walls and cameras"]
MIN_SINE = float(np.sin(np.deg2rad(MAX_ANGLE_DEG)))
"""Walls nearer to parallel than this meet nowhere."""


def floor_frame(scene: Scene, layout: Layout, seen: Sequence[int]) -> tuple[PlaneFrame, Level]:
    """The floor plane, its normal up, with any direction for its axes; and what it was taken from.

    It is that of the largest floor. Without one it is parallel to the largest ceiling; without either it is upright on
    the walls, with the side up that the cameras have up; then it passes through the layout's lowest point.
    ``seen``: indices of the instances whose place is known. Raises GtlayoutError when none of them says where up is.
    """

    def largest(label: Label) -> int | None:
        found = [i for i in seen if layout.instances[i].label == label]
        return max(found, key=lambda i: layout.extents[i].region.area, default=None)

    if (floor := largest("floor")) is not None:
        return PlaneFrame.across(layout.planes[floor].normal, layout.extents[floor].frame.origin), "floor"
    level: Level = "ceiling"
    if (ceiling := largest("ceiling")) is not None:
        up = -layout.planes[ceiling].normal
    else:
        level, up = "walls and cameras", up_of_walls(scene, layout, seen)
    corners = np.concatenate([_corners(layout, i) for i in seen])
    middle = corners.mean(axis=0)
    return PlaneFrame.across(up, middle + ((corners - middle) @ up).min() * up), level


def up_of_walls(scene: Scene, layout: Layout, seen: Sequence[int]) -> FloatArray:
    """(3,) the direction that all walls in ``seen`` have in common, on the side of the cameras' mean up (their −y).

    Raises GtlayoutError when there are none, or they and the cameras leave it open.
    """
    walls = [i for i in seen if layout.instances[i].label == "wall"]
    if not walls:
        raise GtlayoutError(
            "nothing in the layout tells which way is up: it has no floor, ceiling or wall whose place is known"
        )
    cameras_up = np.mean([-frame.camera.R_cam_from_world[1] for frame in scene.frames], axis=0)
    normals = np.stack([layout.planes[i].normal for i in walls])
    _, strength, axes = np.linalg.svd(np.sqrt([[layout.extents[i].region.area] for i in walls]) * normals)
    if len(walls) > 1 and strength[1] > MIN_SINE * strength[0]:
        return axes[2] * np.copysign(1.0, axes[2] @ cameras_up)
    # All walls are parallel: the cameras' up, as far as the walls leave it open.
    level_up: FloatArray = cameras_up - (cameras_up @ axes[0]) * axes[0]
    if np.linalg.norm(level_up) < MIN_SINE:
        raise GtlayoutError(
            "nothing in the layout tells which way is up: its walls are parallel, and the cameras' up is across them"
        )
    return level_up / np.linalg.norm(level_up)


def _corners(layout: Layout, i: int) -> FloatArray:
    extent = layout.extents[i]
    return extent.frame.to_world(shapely.get_coordinates(extent.region))
