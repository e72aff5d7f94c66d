"""Scenes with closed-form answers: a box room seen from inside, and flat surfaces drawn pixel by pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from shapely import MultiPolygon, Polygon, box

from gtlayout.instances import Extent, Instance, Plane, PlaneFrame
from gtlayout.scene import Camera, Element, FloatArray, Frame, KeyFrame, Label, Scene

WIDTH_M, DEPTH_M, HEIGHT_M = 4.0, 5.0, 2.5
WALL_DEPTH = 10.0
"""Depth of the surface that ``facing`` draws on: 10 px a metre."""
NOTHING = MultiPolygon()
Drawing: TypeAlias = tuple[Label, MultiPolygon]
"""An element as drawn, px."""


@dataclass(frozen=True)
class Surface:
    """A planar polygon seen from the side it runs counter-clockwise from."""

    label: Label
    corners: FloatArray
    """(N, 3) world; the first angle is convex."""
    host: int | None = None

    @property
    def plane(self) -> Plane:
        a, b, c = self.corners[[0, 1, -1]]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        return Plane(normal, -float(normal @ a), np.zeros((4, 4)), observable=True)

    @property
    def extent(self) -> Extent:
        plane = self.plane
        e_u = self.corners[1] - self.corners[0]
        e_u /= np.linalg.norm(e_u)
        frame = PlaneFrame(self.corners[0], np.stack([e_u, np.cross(plane.normal, e_u)]))
        region = MultiPolygon([Polygon(frame.to_plane(self.corners))])
        return Extent(frame, region, region)


def rectangle(origin: npt.ArrayLike, u: npt.ArrayLike, v: npt.ArrayLike) -> FloatArray:
    """(4, 3) corners; seen from u × v they run counter-clockwise."""
    start, along, up = (np.asarray(vector, dtype=np.float64) for vector in (origin, u, v))
    return np.stack([start, start + along, start + along + up, start + up])


X, Y, Z = np.diag([WIDTH_M, DEPTH_M, HEIGHT_M])
FLOOR = Surface("floor", rectangle([0, 0, 0], X, Y))
CEILING = Surface("ceiling", rectangle(Z, Y, X))
LEFT = Surface("wall", rectangle([0, 0, 0], Y, Z))
RIGHT = Surface("wall", rectangle(X, Z, Y))
FAR = Surface("wall", rectangle(Y, X, Z))
NEAR = Surface("wall", rectangle([0, 0, 0], Z, X))
BOX = (FLOOR, CEILING, LEFT, RIGHT, FAR, NEAR)


def level_camera(center: npt.ArrayLike, focal: float = 80.0, width: int = 160, height: int = 100) -> Camera:
    """Looks along +y with z up.

    With the defaults, and in the middle of the box room's cross-section, its image border runs along walls, floor and
    ceiling two metres in front of it.
    """
    rotation = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return Camera(K, rotation, -rotation @ np.asarray(center), width, height)


def draw(corners: FloatArray, camera: Camera) -> MultiPolygon:
    """What the camera sees of a planar polygon, exactly: cut by the planes through the image border, then projected."""
    points = corners @ camera.R_cam_from_world.T + camera.t_cam_from_world
    border = np.linalg.inv(camera.K) @ np.array(
        [[0, camera.width, camera.width, 0], [0, 0, camera.height, camera.height], [1, 1, 1, 1]]
    )
    for k in range(4):
        inward = np.cross(border[:, k], border[:, (k + 1) % 4])
        side = points @ inward
        kept: list[FloatArray] = []
        for i in range(len(points)):
            j = (i + 1) % len(points)
            if side[i] >= 0:
                kept.append(points[i])
            if (side[i] >= 0) != (side[j] >= 0):
                kept.append(points[i] + side[i] / (side[i] - side[j]) * (points[j] - points[i]))
        if len(kept) < 3:
            return NOTHING
        points = np.stack(kept)
    pixels = points @ camera.K.T
    return MultiPolygon([Polygon(pixels[:, :2] / pixels[:, 2:])])


def make_scene(cameras: Sequence[Camera], drawings: Sequence[Sequence[Drawing]]) -> Scene:
    """All frames are key frames; element e of each is the e-th drawing and is wholly visible."""
    frames = tuple(Frame(f"{k}.png", Path(f"{k}.png"), camera) for k, camera in enumerate(cameras))
    key_frames = tuple(
        KeyFrame(k, tuple(Element(f"e{e}", label, drawn, drawn) for e, (label, drawn) in enumerate(drawing)))
        for k, drawing in enumerate(drawings)
    )
    return Scene(Path("made"), frames, key_frames, metric=True)


def instances_of(surfaces: Sequence[Surface], key_frames: int) -> tuple[Instance, ...]:
    """One instance a surface, drawn as the element of the same number in every key frame."""
    return tuple(
        Instance(f"{surface.label}_{i}", surface.label, tuple((k, i) for k in range(key_frames)), surface.host)
        for i, surface in enumerate(surfaces)
    )


def seen_from(cameras: Sequence[Camera], surfaces: Sequence[Surface]) -> Scene:
    """The scene in which an annotator draws every surface without error."""
    return make_scene(cameras, [[(s.label, draw(s.corners, camera)) for s in surfaces] for camera in cameras])


def redraw(scene: Scene, key_frame: int, element: int, amodal: MultiPolygon) -> Scene:
    """The scene with one element drawn differently."""
    elements = list(scene.key_frames[key_frame].elements)
    elements[element] = replace(elements[element], amodal=amodal, visible=amodal)
    key_frames = list(scene.key_frames)
    key_frames[key_frame] = replace(key_frames[key_frame], elements=tuple(elements))
    return replace(scene, key_frames=tuple(key_frames))


def with_depth(scene: Scene, paths: Sequence[Path | None]) -> Scene:
    """The scene with a depth map for each frame that has a path."""
    frames = zip(scene.frames, paths, strict=True)
    return replace(scene, frames=tuple(replace(frame, depth_path=path) for frame, path in frames))


def facing_camera() -> Camera:
    """100x80 px at the origin; pixel (x, y) looks at (x − 50, 40 − y) / 10 metres on the plane ``facing`` draws on."""
    return level_camera([0, 0, 0], focal=100.0, width=100, height=80)


def pixels(left: float, top: float, right: float, bottom: float) -> MultiPolygon:
    """A box in the image."""
    return MultiPolygon([box(left, top, right, bottom)])


def facing(
    left: float, top: float, right: float, bottom: float, label: Label = "wall", host: int | None = None
) -> Surface:
    """The surface at depth ``WALL_DEPTH`` that ``facing_camera`` sees as that box of pixels."""
    x0, x1, z0, z1 = (left - 50) / 10, (right - 50) / 10, (40 - bottom) / 10, (40 - top) / 10
    return Surface(label, rectangle([x0, WALL_DEPTH, z0], [x1 - x0, 0, 0], [0, 0, z1 - z0]), host)
