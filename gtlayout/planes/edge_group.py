"""A contact edge as a key frame shows it, against the planes that meet there."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely
from shapely import MultiPoint

from gtlayout.factors import EdgeView
from gtlayout.geometry.rays import depth_on_plane
from gtlayout.scene import Camera, FloatArray

FARTHEST_PX = 100.0
"""Largest distance of an edge that counts, in an image of 640x480. Planes that coincide have no line at all."""
MIN_DIHEDRAL = 0.2
"""Planes at less than this angle (radians) have no edge that an annotator would draw."""


@dataclass(frozen=True)
class EdgeGroup:
    """The contact edge of two instances in one key frame."""

    camera: Camera
    instances: tuple[int, int]
    """The smaller number first."""
    points_px: FloatArray
    key_frame: int = field(kw_only=True)

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
        clearance = planes[:, :3] @ self.center + planes[:, 3]
        neighbour_clearance = neighbour[:3] @ self.center + neighbour[3]
        through = clearance[:, None] * neighbour[:3] - neighbour_clearance * planes[:, :3]
        # Component by component: sums of two or three numbers each take NumPy several times as long.
        (x, y, z), lines = through.T, through @ self.line_by_normal
        nearest = MIN_DIHEDRAL * np.maximum(abs(clearance), abs(neighbour_clearance))
        coplanar = np.sqrt(x * x + y * y + z * z) <= nearest
        length = np.maximum(np.sqrt(lines[:, 0] ** 2 + lines[:, 1] ** 2), 1e-12)
        return np.where(coplanar[:, None], np.inf, (lines @ self._homogeneous.T) / length[:, None])

    @cached_property
    def center(self) -> FloatArray:
        """(3,) of the camera, in the world of the planes."""
        return self.camera.center_world

    @cached_property
    def line_by_normal(self) -> FloatArray:
        """(3, 3) takes the normal of a plane through the camera's centre to its line in the image."""
        return np.asarray(np.linalg.inv(self.camera.K @ self.camera.R_cam_from_world))

    @cached_property
    def seen(self) -> EdgeView:
        """Its representatives, as factors take them."""
        camera = self.camera
        projection = camera.K @ np.column_stack([camera.R_cam_from_world, camera.t_cam_from_world])
        return EdgeView.of(self.representatives_px, projection)

    @cached_property
    def _homogeneous(self) -> FloatArray:
        return np.column_stack([self.points_px, np.ones(len(self.points_px))])

    def misfits_px(self, planes: FloatArray, offset: FloatArray | None = None) -> FloatArray:
        """(P,) the same for the edge's own two of (S, 4) ``planes``, from their line moved by (3,) ``offset``."""
        a, b = self.instances
        if offset is not None:
            planes = planes - np.pad(planes[:, :3] @ offset[:, None], ((0, 0), (3, 0)))
        return self.distances_px(planes[a][None], planes[b])[0]

    def feet_px(self, planes: FloatArray, offset: FloatArray) -> FloatArray:
        """(P, 2) the points of the line in which its own two of (S, 4) ``planes`` meet, moved by (3,) ``offset``, that
        are nearest to its points.
        """
        a, b = planes[list(self.instances)]
        clearance_a, clearance_b = (plane[:3] @ (self.center - offset) + plane[3] for plane in (a, b))
        line = (clearance_a * b[:3] - clearance_b * a[:3]) @ self.line_by_normal
        across = line[:2] / max(float(line[:2] @ line[:2]), 1e-24)
        feet: FloatArray = self.points_px - (self._homogeneous @ line)[:, None] * across
        return feet

    def annotation_px(self, misfits_px: FloatArray) -> FloatArray:
        """(P,) misfits as of an image of 640x480, up to ``FARTHEST_PX``."""
        return np.clip(misfits_px / self.camera.annotation_scale, -FARTHEST_PX, FARTHEST_PX)

    @cached_property
    def hull(self) -> EdgeGroup:
        """The same edge as the corners of its points' hull: one of these is farthest from any line."""
        hull = MultiPoint(self.points_px).convex_hull
        return replace(self, points_px=shapely.get_coordinates(hull))

    @cached_property
    def ends(self) -> EdgeGroup:
        """The same edge as its two representatives."""
        return replace(self, points_px=self.representatives_px)

    def ends_on(self, plane: FloatArray) -> FloatArray:
        """(2, 3) points of the edge's two ends on one of its planes."""
        rays = self._end_rays
        depth = depth_on_plane(plane[:3] @ self.center + plane[3], rays @ plane[:3])
        return self.center + depth[:, None] * rays

    @cached_property
    def _end_rays(self) -> FloatArray:
        return self.camera.rays_world(self.points_px[[0, -1]])
