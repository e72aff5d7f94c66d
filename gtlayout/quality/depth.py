"""σ of depth: where something is drawn, and at one point of each instance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.raster import annotated_labels
from gtlayout.instances import Instance, Plane
from gtlayout.scene import Camera, FloatArray, IntArray, Scene

_STEP_PX = 4
"""Grid on which σ of depth is sampled: planes have no detail."""


@dataclass(frozen=True)
class DrawnPixels:
    """Pixels of all key frames that something is drawn on, on a grid."""

    instance: IntArray
    """(N,) that lies on top."""
    distance: FloatArray
    """(N,) from the camera to its plane, world unit; NaN where the plane is not seen."""
    sigma_share: FloatArray
    """(N,) σ of depth as a share of it, at most 1; 1 also where a plane is unobservable or not seen."""


def drawn_pixels(scene: Scene, instances: Sequence[Instance], planes: Sequence[Plane]) -> DrawnPixels:
    """How far off, and how well known, what is drawn in all key frames is."""
    owners, distances, shares = [np.empty(0, dtype=np.int64)], [np.empty(0)], [np.empty(0)]
    for k in range(len(scene.key_frames)):
        camera = scene.frame_of(k).camera
        labels = annotated_labels(scene, instances, k)[::_STEP_PX, ::_STEP_PX]
        for i in np.unique(labels[labels >= 0]):
            y, x = np.nonzero(labels == i)
            points_px = np.column_stack([x, y]).astype(np.float64) * _STEP_PX + 0.5
            sigma, depth = _sigma_depth(planes[i], camera, points_px)
            known = planes[i].observable & (sigma < depth)
            owners.append(np.full(len(x), i))
            distances.append(depth * np.linalg.norm(camera.rays_world(points_px), axis=1))
            shares.append(np.where(known, sigma / depth, 1.0))
    return DrawnPixels(np.concatenate(owners), np.concatenate(distances), np.concatenate(shares))


def centroid_of_largest(scene: Scene, instance: Instance) -> tuple[Camera, FloatArray]:
    """The camera that the largest annotated polygon of an instance was drawn in, and its centroid there, (1, 2) px."""
    k, element = max(instance.members, key=lambda member: scene.key_frames[member[0]].elements[member[1]].amodal.area)
    centroid = scene.key_frames[k].elements[element].amodal.centroid
    return scene.frame_of(k).camera, np.array([[centroid.x, centroid.y]])


def depth_at_centroid(scene: Scene, instance: Instance, plane: Plane) -> tuple[float, float]:
    """σ of the depth, and the depth, where the plane is seen through the centroid of the largest annotated polygon."""
    sigma, depth = _sigma_depth(plane, *centroid_of_largest(scene, instance))
    return float(sigma[0]), float(depth[0])


def _sigma_depth(plane: Plane, camera: Camera, points_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) σ of the depth, and the depth, at which a plane is seen at (N, 2) pixels; NaN where it is not."""
    inverse = np.column_stack([points_px, np.ones(len(points_px))]) @ inverse_depth(plane, camera)
    # Zero on the horizon, infinite for a camera on the plane.
    depth = 1 / np.where((inverse > 0) & np.isfinite(inverse), inverse, np.nan)
    rays = camera.rays_world(points_px)
    return plane.sigma_depth(camera.center_world + depth[:, None] * rays, rays), depth
