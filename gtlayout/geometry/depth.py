"""Depths of planes where elements are drawn, and their σ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely

from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import homogeneous
from gtlayout.geometry.strip import StripFrame, sigma_depth_on
from gtlayout.instances import Instance, Plane
from gtlayout.scene import Camera, FloatArray, Scene


def median_depth(scene: Scene, instances: Sequence[Instance], planes: Sequence[Plane]) -> float:
    """The scene's scale: median depth of the elements' vertices on their planes, world unit; inf when none is seen."""
    depths = []
    for instance, plane in zip(instances, planes, strict=True):
        for key_frame, element in instance.members if plane.observable else ():
            region = scene.key_frames[key_frame].elements[element].amodal
            coefficients = inverse_depth(plane, scene.frame_of(key_frame).camera)
            if np.isfinite(coefficients).all():
                inverse = homogeneous(shapely.get_coordinates(region)) @ coefficients
                depths.append(1 / inverse[inverse > 0])
    found = np.concatenate(depths) if depths else np.empty(0)
    return float(np.median(found)) if len(found) else np.inf


def centroid_of_largest(scene: Scene, instance: Instance) -> tuple[Camera, FloatArray]:
    """The camera of the key frame with the largest element of an instance, and the element's centroid, (1, 2) px."""
    k, element = max(instance.members, key=lambda member: scene.key_frames[member[0]].elements[member[1]].amodal.area)
    centroid = scene.key_frames[k].elements[element].amodal.centroid
    return scene.frame_of(k).camera, np.array([[centroid.x, centroid.y]])


def depth_at_centroid(
    scene: Scene, instance: Instance, plane: Plane, strip: StripFrame | None = None
) -> tuple[float, float]:
    """σ of the depth, and the depth, where the plane is seen through the centroid of the largest element.

    Of a curved wall that of its ``strip``.
    """
    seen = centroid_of_largest(scene, instance)
    sigma, depth = sigma_depth(plane, *seen) if strip is None else sigma_depth_on(strip, *seen)
    return float(sigma[0]), float(depth[0])


def sigma_depth(plane: Plane, camera: Camera, points_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) σ of the depth, and the depth, at which a plane is seen at (N, 2) pixels; NaN where it is not."""
    inverse = np.column_stack([points_px, np.ones(len(points_px))]) @ inverse_depth(plane, camera)
    # Zero on the horizon, infinite for a camera on the plane.
    depth = 1 / np.where((inverse > 0) & np.isfinite(inverse), inverse, np.nan)
    rays = camera.rays_world(points_px)
    return plane.sigma_depth(camera.center_world + depth[:, None] * rays, rays), depth


def with_sigma_depth(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    strips: Mapping[int, StripFrame] | None = None,
) -> tuple[Plane, ...]:
    """The planes with the σ of their depth, where the scene's unit is the metre; of curved walls that of ``strips``."""
    if not scene.metric:
        return tuple(planes)
    on = strips or {}
    return tuple(
        replace(plane, sigma_depth_m=depth_at_centroid(scene, instance, plane, on.get(i))[0])
        if plane.observable
        else plane
        for i, (instance, plane) in enumerate(zip(instances, planes, strict=True))
    )
