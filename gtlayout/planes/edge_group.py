"""A contact edge as a key frame shows it, against the planes that meet there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gtlayout.geometry.rays import depth_on_plane
from gtlayout.scene import Camera, FloatArray

FARTHEST_PX = 100.0
"""Largest distance of an edge that counts, in an image of 640x480. Planes that coincide have no line at all."""
_MIN_DIHEDRAL = 0.2
"""Planes at less than this angle (radians) have no edge that an annotator would draw."""


@dataclass(frozen=True)
class EdgeGroup:
    """The contact edge of two instances in one key frame."""

    camera: Camera
    instances: tuple[int, int]
    """The smaller number first."""
    points_px: FloatArray

    def other(self, instance: int) -> int:
        """The instance on its other side."""
        return self.instances[1] if self.instances[0] == instance else self.instances[0]

    @cached_property
    def representatives_px(self) -> FloatArray:
        """(2, 2) the two points that stand for the edge: mean ± one standard deviation along it."""
        mean = self.points_px.mean(axis=0)
        _, spread, axes = np.linalg.svd(self.points_px - mean, full_matrices=False)
        step = spread[0] / np.sqrt(len(self.points_px)) * axes[0]
        return np.array([mean - step, mean + step])

    def distances_px(self, planes: FloatArray, neighbour: FloatArray) -> FloatArray:
        """(H, P) distance of the edge's points from the line in which each of (H, 4) planes meets ``neighbour``.

        Infinite for planes that coincide with it: instances that touch along an edge have two planes.
        """
        clearance = planes[:, :3] @ self._center + planes[:, 3]
        neighbour_clearance = neighbour[:3] @ self._center + neighbour[3]
        through = clearance[:, None] * neighbour[:3] - neighbour_clearance * planes[:, :3]
        coplanar = np.linalg.norm(through, axis=1) <= _MIN_DIHEDRAL * np.maximum(
            abs(clearance), abs(neighbour_clearance)
        )
        lines = through @ self._line_by_normal
        length = np.maximum(np.linalg.norm(lines[:, :2], axis=1), 1e-12)
        return np.where(coplanar[:, None], np.inf, (lines @ self._homogeneous.T) / length[:, None])

    def shift_and_tilt_px(self, planes: FloatArray, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(2,) half-sum and half-difference of the representatives' distances from the line in which its two of (S, 4)
        ``planes`` meet, moved by ``offset``, and their (2, 3) derivative by it. As of an image of 640x480; zero for
        planes that coincide.
        """
        a, b = (planes[s] for s in self.instances)
        center = self._center - offset
        through = (a[:3] @ center + a[3]) * b[:3] - (b[:3] @ center + b[3]) * a[:3]
        line = through @ self._line_by_normal
        length = float(np.hypot(line[0], line[1]))
        if np.linalg.norm(through) <= _MIN_DIHEDRAL * max(abs(a[:3] @ center + a[3]), abs(b[:3] @ center + b[3])):
            return np.zeros(2), np.zeros((2, 3))
        u = np.column_stack([self.representatives_px, np.ones(2)])
        px = u @ line / length
        by_line = (u - px[:, None] * np.array([line[0], line[1], 0.0]) / length) / length
        g = by_line @ self._line_by_normal.T
        by_offset = np.outer(g @ a[:3], b[:3]) - np.outer(g @ b[:3], a[:3])
        mix = np.array([[0.5, 0.5], [0.5, -0.5]]) / self.camera.annotation_scale
        return np.clip(mix @ px, -FARTHEST_PX, FARTHEST_PX), mix @ by_offset

    @cached_property
    def _center(self) -> FloatArray:
        return self.camera.center_world

    @cached_property
    def _line_by_normal(self) -> FloatArray:
        """(3, 3) takes the normal of a plane through the camera's centre to its line in the image."""
        return np.asarray(np.linalg.inv(self.camera.K @ self.camera.R_cam_from_world))

    @cached_property
    def _homogeneous(self) -> FloatArray:
        return np.column_stack([self.points_px, np.ones(len(self.points_px))])

    def misfits_px(self, planes: FloatArray, offset: FloatArray | None = None) -> FloatArray:
        """(P,) the same for the edge's own two of (S, 4) ``planes``, from their line moved by (3,) ``offset``."""
        a, b = self.instances
        if offset is not None:
            planes = planes - np.pad(planes[:, :3] @ offset[:, None], ((0, 0), (3, 0)))
        return self.distances_px(planes[a][None], planes[b])[0]

    def annotation_px(self, misfits_px: FloatArray) -> FloatArray:
        """(P,) misfits as of an image of 640x480, up to ``FARTHEST_PX``."""
        return np.clip(misfits_px / self.camera.annotation_scale, -FARTHEST_PX, FARTHEST_PX)

    @cached_property
    def ends(self) -> EdgeGroup:
        """The same edge as its two representatives."""
        return replace(self, points_px=self.representatives_px)

    def ends_on(self, plane: FloatArray) -> FloatArray:
        """(2, 3) points of the edge's two ends on one of its planes."""
        rays = self._end_rays
        depth = depth_on_plane(plane[:3] @ self._center + plane[3], rays @ plane[:3])
        return self._center + depth[:, None] * rays

    @cached_property
    def _end_rays(self) -> FloatArray:
        return self.camera.rays_world(self.points_px[[0, -1]])
