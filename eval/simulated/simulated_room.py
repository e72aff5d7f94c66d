"""Rooms without images: cameras on a path, and exact polygons per key frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.instances import Instance
from gtlayout.scene import Camera, Element, FloatArray, Frame, IntArray, KeyFrame, Label, Scene

K = np.array([[400.0, 0, 322], [0, 405, 238], [0, 0, 1]])
SIZE = (640, 480)


@dataclass(frozen=True)
class Face:
    """A flat polygon in the world."""

    label: Label
    corners: FloatArray
    """(C, 3), clockwise seen from inside the room."""

    @property
    def plane(self) -> FloatArray:
        """(4,) normal into the room, and d."""
        a, b, c = self.corners[:3]
        normal = np.cross(c - a, b - a)
        normal /= np.linalg.norm(normal)
        return np.append(normal, -normal @ a)


@dataclass(frozen=True)
class Room:
    """A simulated scene and the truth about it."""

    scene: Scene
    faces: tuple[Face, ...]
    instances: tuple[Instance, ...]
    """The true ones, one per face that is seen."""
    planes: FloatArray
    """(S, 4) of the instances."""

    @cached_property
    def instance_of(self) -> list[IntArray]:
        """Per key frame, (elements,) the true instance of each."""
        found = [np.full(len(key_frame.elements), -1) for key_frame in self.scene.key_frames]
        for i, instance in enumerate(self.instances):
            for k, element in instance.members:
                found[k][element] = i
        return found

    def seen_center(self, i: int) -> FloatArray:
        """(3,) a point of instance ``i`` amid what the key frames show of it."""
        points = []
        for k, element in self.instances[i].members:
            drawn = self.scene.key_frames[k].elements[element]
            points.append(unproject(self.scene.frame_of(k).camera, _xy(drawn.amodal.centroid), self.planes[i]))
        return np.mean(np.concatenate(points), axis=0)

    def index(self, label: Label, k: int = 0) -> int:
        """The instance with this label that covers most of key frame ``k``."""
        elements = self.scene.key_frames[k].elements
        best = max(
            (e for e in range(len(elements)) if elements[e].label == label), key=lambda e: elements[e].amodal.area
        )
        return int(self.instance_of[k][best])


def box_faces(width: float = 4.0, length: float = 5.0, height: float = 2.5) -> tuple[Face, ...]:
    """Floor, ceiling and four walls of a box with a corner at the origin, z up."""
    x, y, z = width, length, height
    quads: list[tuple[Label, list[list[float]]]] = [
        ("floor", [[0, 0, 0], [0, y, 0], [x, y, 0], [x, 0, 0]]),
        ("ceiling", [[0, 0, z], [x, 0, z], [x, y, z], [0, y, z]]),
        ("wall", [[0, 0, 0], [0, 0, z], [0, y, z], [0, y, 0]]),
        ("wall", [[x, 0, 0], [x, y, 0], [x, y, z], [x, 0, z]]),
        ("wall", [[0, 0, 0], [x, 0, 0], [x, 0, z], [0, 0, z]]),
        ("wall", [[0, y, 0], [0, y, z], [x, y, z], [x, y, 0]]),
    ]
    return tuple(Face(label, np.array(corners, dtype=np.float64)) for label, corners in quads)


def prism_faces(walls: int, radius: float = 3.0, height: float = 2.5) -> tuple[Face, ...]:
    """Floor, ceiling and so many equal walls round the origin, corners at ``radius``, z up."""
    angle = 2 * np.pi * np.arange(walls) / walls
    floor = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(walls)])
    ceiling = floor + np.array([0.0, 0.0, height])
    sides = [np.array([floor[i], ceiling[i], ceiling[i - 1], floor[i - 1]]) for i in range(walls)]
    return (Face("floor", floor[::-1]), Face("ceiling", ceiling), *(Face("wall", side) for side in sides))


def look_at(center: FloatArray, target: FloatArray, intrinsics: FloatArray = K, size: tuple[int, int] = SIZE) -> Camera:
    """A camera at ``center`` that looks at ``target``, z up in the world."""
    forward = (target - center) / np.linalg.norm(target - center)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(forward, right), forward])
    return Camera(intrinsics, rotation, -rotation @ center, *size)


def orbit(frames: int = 21, sweep_m: float = 1.4) -> list[Camera]:
    """A hand-held arc in front of the far corner of the box."""
    target = np.array([3.0, 4.2, 1.15])
    cameras = []
    for share in np.linspace(-0.5, 0.5, frames):
        center = np.array([1.2, 1.1, 1.4]) + share * sweep_m * np.array([0.8, -0.6, 0.0])
        center[2] += 0.07 * sweep_m * np.sin(5 * share)
        cameras.append(look_at(center, target))
    return cameras


def dolly(frames: int = 31, length_m: float = 0.6) -> list[Camera]:
    """A slow move half forwards, half sideways towards the far corner of the box, hardly turning."""
    along = np.linspace(-0.5, 0.5, frames)
    centers = np.array([1.6, 0.9, 1.4]) + length_m * along[:, None] * np.array([0.7, 0.7, 0.1])
    targets = np.array([2.6, 4.6, 1.15]) + along[:, None] * np.array([0.5, 0.0, 0.0])
    return [look_at(center, target) for center, target in zip(centers, targets, strict=True)]


def ring(frames: int, radius: float = 0.6) -> list[Camera]:
    """A full turn round the origin, looking across it."""
    angle = 2 * np.pi * np.arange(frames) / frames
    outwards = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(frames)])
    return [
        look_at(radius * out + np.array([0.0, 0.0, 1.4]), -3.0 * out + np.array([0.0, 0.0, 1.2])) for out in outwards
    ]


def make_room(
    cameras: Sequence[Camera],
    key_frames: Sequence[int],
    faces: Sequence[Face] | None = None,
    scale: float = 1.0,
    shift: FloatArray | None = None,
    metric: bool = True,
    seed: int = 0,
    min_area_px: float = 1500.0,
) -> Room:
    """Annotate the key frames exactly, elements in an order (and with ids) that changes from frame to frame.

    ``scale`` and ``shift`` move the whole world: pixels stay the same.
    """
    rng = np.random.default_rng(seed)
    origin = np.zeros(3) if shift is None else shift
    moved = [replace(c, t_cam_from_world=scale * c.t_cam_from_world - c.R_cam_from_world @ origin) for c in cameras]
    faces = tuple(replace(f, corners=scale * f.corners + origin) for f in faces or box_faces())
    frames = tuple(Frame(f"{i:03d}.png", Path("/nowhere") / f"{i:03d}.png", c) for i, c in enumerate(moved))
    annotated: list[KeyFrame] = []
    members: dict[int, list[tuple[int, int]]] = {}
    for k, f in enumerate(key_frames):
        drawn = [(i, draw(moved[f], face, 0.05 * scale)) for i, face in enumerate(faces)]
        drawn = [(i, region) for i, region in drawn if region.area > min_area_px]
        elements = []
        for e, n in enumerate(rng.permutation(len(drawn))):
            i, region = drawn[n]
            elements.append(Element(f"e{e}", faces[i].label, region, as_multi(region.buffer(-5.0))))
            members.setdefault(i, []).append((k, e))
        annotated.append(KeyFrame(f, tuple(elements)))
    scene = Scene(Path("/nowhere"), frames, tuple(annotated), metric)
    instances = tuple(Instance(f"{faces[i].label}_{i}", faces[i].label, tuple(members[i])) for i in members)
    return Room(scene, faces, instances, np.array([faces[i].plane for i in members]))


def draw(camera: Camera, face: Face, near: float) -> MultiPolygon:
    """A face's image, cut at the near plane and the image border."""
    corners = face.corners @ camera.R_cam_from_world.T + camera.t_cam_from_world
    kept: list[FloatArray] = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] >= near:
            kept.append(a)
        if (a[2] >= near) != (b[2] >= near):
            kept.append(a + (near - a[2]) / (b[2] - a[2]) * (b - a))
    if len(kept) < 3:
        return MultiPolygon()
    homogeneous = np.array(kept) @ camera.K.T
    image = shapely.box(0, 0, camera.width, camera.height)
    return as_multi(Polygon(homogeneous[:, :2] / homogeneous[:, 2:]).intersection(image))


def as_multi(region: Polygon | MultiPolygon) -> MultiPolygon:
    """Polygon or MultiPolygon as the latter."""
    if region.is_empty:
        return MultiPolygon()
    return MultiPolygon([region]) if region.geom_type == "Polygon" else region


def _xy(point: shapely.Point) -> FloatArray:
    return np.array([[point.x, point.y]])


def unproject(camera: Camera, points_px: FloatArray, plane: FloatArray) -> FloatArray:
    """(N, 3) where a (4,) plane is seen at (N, 2) pixels."""
    rays = camera.rays_world(points_px)
    depth = -(plane[:3] @ camera.center_world + plane[3]) / (rays @ plane[:3])
    return camera.center_world + depth[:, None] * rays
