"""A solved room as lengths and areas are taken from it, and how its corners move with its planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from gtlayout.dimensions.drawing_noise import drawn_sigma_px
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import Extent, Instance, Plane
from gtlayout.scene import OPENINGS, BoolArray, FloatArray, Scene

_REACH_SHARE = 0.005
"""A corner lies on another surface that is nearer than this share of the room's size: 4 cm in one of 8 m. Drawn lines
lie so far from where planes meet (plinths, worktops)."""
_LEAST_SINE = 0.17
"""Of the angle between planes that meet in a line, or between a line and a plane that meet in a corner: 10°."""
_LEAST_COSINE = 0.2
"""A free corner moves along the ray through it; a ray nearer to the plane than this would throw it far."""


@dataclass(frozen=True)
class SolvedRoom:
    """What stages 4 and 5 found, in one world."""

    scene: Scene
    instances: Sequence[Instance]
    planes: Sequence[Plane]
    extents: Sequence[Extent]

    @cached_property
    def eye_world(self) -> FloatArray:
        """(3,) the mean of all cameras."""
        return np.asarray(np.mean([frame.camera.center_world for frame in self.scene.frames], axis=0))

    @cached_property
    def size(self) -> float:
        """The diagonal of the box around all extents, world unit; 0 without any."""
        corners = [extent.frame.to_world(shapely.get_coordinates(extent.region)) for extent in self.extents]
        every = np.concatenate(corners) if corners else np.empty((0, 3))
        return float(np.linalg.norm(np.ptp(every, axis=0))) if len(every) else 0.0

    @cached_property
    def up_world(self) -> FloatArray | None:
        """(3,) up: the normal of the largest floor, against that of the largest ceiling, or what the walls share.

        None when nothing tells: no floor, no ceiling, and no two walls at an angle.
        """
        for label, sign in (("floor", 1.0), ("ceiling", -1.0)):
            found = [i for i in self.seen if self.instances[i].label == label]
            if found:
                largest = max(found, key=lambda i: self.extents[i].region.area)
                return sign * self.planes[largest].normal
        walls = [self.planes[i].normal for i in self.seen if self.instances[i].label == "wall"]
        if len(walls) < 2:
            return None
        _, strength, axes = np.linalg.svd(np.stack(walls))
        if strength[1] < _LEAST_SINE * strength[0]:
            return None
        cameras_up = np.mean([-frame.camera.R_cam_from_world[1] for frame in self.scene.frames], axis=0)
        return np.asarray(axes[2] * np.copysign(1.0, axes[2] @ cameras_up))

    @cached_property
    def seen(self) -> list[int]:
        """The instances that have a place and an extent."""
        return [
            i
            for i, (plane, extent) in enumerate(zip(self.planes, self.extents, strict=True))
            if plane.observable and not extent.region.is_empty
        ]

    @cached_property
    def drawn_sigma_px(self) -> float:
        """σ of a drawn edge, as ``drawing_noise.drawn_sigma_px`` has it."""
        return drawn_sigma_px(self.scene, self.instances, self.extents, self.seen, self.size)

    def moved_by(self, index: int, point_world: FloatArray) -> FloatArray:
        """(4,) what ``normal · point + d`` of a plane changes by, by its (normal, normal · anchor + d)."""
        return np.append(point_world - self.planes[index].anchor, 1.0)

    def on_others(self, index: int, points_world: FloatArray) -> list[list[int]]:
        """Of each of (N, 3) points on an instance the other surfaces that it lies on: at most two, nearest first.

        They fix the point together with its own plane. Doors, windows and curved walls fix nothing but themselves.
        """
        own, reach = self.planes[index].normal, _REACH_SHARE * self.size
        near: dict[int, tuple[BoolArray, FloatArray]] = {}
        for j in self.seen:
            if j == index or self.instances[j].label in OPENINGS or strip_of(self.extents[j]):
                continue
            plane, extent = self.planes[j], self.extents[j]
            if np.linalg.norm(np.cross(own, plane.normal)) < _LEAST_SINE:
                continue
            off = np.abs(points_world @ plane.normal + plane.d)
            flat = shapely.distance(extent.region, shapely.points(extent.frame.to_plane(points_world)))
            near[j] = (off < reach) & (flat < reach), off
        found = []
        for p in range(len(points_world)):
            by_distance = sorted((float(off[p]), j) for j, (is_near, off) in near.items() if is_near[p])
            chosen: list[int] = []
            for _, j in by_distance:
                normals = np.stack([own, *(self.planes[k].normal for k in (*chosen, j))])
                if len(chosen) < 2 and np.linalg.svd(normals, compute_uv=False)[-1] > _LEAST_SINE / 2:
                    chosen.append(j)
            found.append(chosen)
        return found

    def motion(self, index: int, points_world: FloatArray, others: Sequence[Sequence[int]]) -> FloatArray:
        """(N, 3, 4S) how (N, 3) points on an instance move with all planes.

        A corner stays where its own plane and the ``others`` of ``on_others`` meet, and moves no more than that asks
        for. A free point moves along the ray from the cameras: it was drawn there.
        """
        motion = np.zeros((len(points_world), 3, 4 * len(self.planes)))
        for p, (point, beside) in enumerate(zip(points_world, others, strict=True)):
            surfaces = [index, *beside]
            normals = np.stack([self.planes[j].normal for j in surfaces])
            if beside:
                back = np.linalg.pinv(normals)
            else:
                ray = point - self.eye_world
                ray = ray / max(float(np.linalg.norm(ray)), 1e-12)
                facing = float(normals[0] @ ray)
                back = (ray / np.copysign(max(abs(facing), _LEAST_COSINE), facing))[:, None]
            for column, j in enumerate(surfaces):
                motion[p, :, 4 * j : 4 * j + 4] -= np.outer(back[:, column], self.moved_by(j, point))
        return motion

    def drawn_sigma(self, index: int, point_world: FloatArray, across_world: FloatArray) -> float:
        """σ of where an instance's outline passes a point on its plane: what its key frames' drawings leave together.

        ``across_world``, (3,) in the plane, is the direction that it is asked for, at right angles to the outline. Seen
        at a grazing angle a pixel is long. Infinite where no key frame shows the point.
        """
        along_world = np.cross(self.planes[index].normal, across_world)
        information = 0.0
        for k, _ in self.instances[index].members:
            camera = self.scene.frame_of(k).camera
            depth = float(camera.project(point_world[None])[1][0])
            if depth <= 0:
                continue
            step = 1e-6 * depth
            points_px, _ = camera.project(point_world + step * np.stack([0 * along_world, across_world, along_world]))
            (across_x, across_y), (along_x, along_y) = (points_px[1:] - points_px[0]) / step
            # Of a shift across the outline only what is across its image can be seen.
            px_per_unit = abs(across_x * along_y - across_y * along_x) / max(float(np.hypot(along_x, along_y)), 1e-300)
            information += (px_per_unit / (self.drawn_sigma_px * camera.annotation_scale)) ** 2
        return float(1 / np.sqrt(information)) if information > 0 else np.inf
