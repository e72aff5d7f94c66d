"""The box room with a door and a window, somewhere in the world: what exports are tested on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import rooms
from scipy.spatial.transform import Rotation

from gtlayout.instances import Dimension
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.scene import Camera, Frame, Scene

TURN = Rotation.from_euler("xyz", [20, -110, 65], degrees=True).as_matrix()
"""World from room: exports must not count on z up."""
SHIFT = np.array([0.5, -3.0, 7.0])
DOOR = rooms.Surface("door", rooms.rectangle([1.5, 5.0, 0], [1.0, 0, 0], [0, 0, 2.0]), host=4)
WINDOW = rooms.Surface("window", rooms.rectangle([0, 1.0, 1.0], [0, 1.5, 0], [0, 0, 1.0]), host=2)
SURFACES = (*rooms.BOX, DOOR, WINDOW)
SIGMA = 0.02


def made(folder: Path, surfaces: Sequence[rooms.Surface] = SURFACES) -> tuple[Scene, Layout]:
    cameras = [rooms.level_camera([2.0, y, 1.25]) for y in (1.5, 1.0)]
    seen = rooms.seen_from(cameras, surfaces)
    frames = []
    for frame in seen.frames:
        (folder / "images").mkdir(exist_ok=True)
        image = folder / "images" / frame.name
        cv2.imwrite(str(image), np.full((100, 160, 3), 90, dtype=np.uint8))
        frames.append(Frame(frame.name, image, _moved_camera(frame.camera)))
    scene = replace(seen, root=folder, frames=tuple(frames))
    moved = [replace(surface, corners=surface.corners @ TURN.T + SHIFT) for surface in surfaces]
    instances, extents = rooms.instances_of(surfaces, 2), tuple(surface.extent for surface in moved)
    planes = tuple(replace(surface.plane, covariance=np.diag([0, 0, 0, SIGMA**2])) for surface in moved)
    ends = np.array(
        [[[0, 1.0, 1.25], [4.0, 1.0, 1.25]], [[2.0, 0, 1.25], [2.0, 5.0, 1.25]], [[2.0, 1, 0], [2.0, 1, 2.5]]]
    )
    width, depth, height = ends @ TURN.T + SHIFT
    dimensions = (
        Dimension(2, 3, "width", 4.0, 0.0123, width),
        Dimension(5, 4, "width", 5.0, 0.2, depth),
        Dimension(0, 1, "height", 2.5, np.nan, height),
    )
    return scene, Layout(
        instances, planes, extents, build_mesh(instances, extents), True, dimensions if surfaces is SURFACES else ()
    )


def _moved_camera(camera: Camera) -> Camera:
    rotation = camera.R_cam_from_world @ TURN.T
    return replace(camera, R_cam_from_world=rotation, t_cam_from_world=camera.t_cam_from_world - rotation @ SHIFT)
