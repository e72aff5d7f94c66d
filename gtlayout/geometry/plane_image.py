"""A plane as a camera sees it: the one place in which rays meet planes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.polygons import half_plane, homogeneous
from gtlayout.instances import Instance, Plane
from gtlayout.scene import Camera, FloatArray, Scene


def inverse_depth(plane: Plane, camera: Camera) -> FloatArray:
    """(3,) coefficients (a, b, c) of the plane's inverse depth in the image: 1/z = a x + b y + c at pixel (x, y).

    It is zero on the horizon and negative where the pixel's ray misses the plane. Infinite when the camera lies on it.
    """
    normal_cam = camera.R_cam_from_world @ plane.normal
    distance = float(plane.normal @ camera.center_world) + plane.d
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-np.linalg.solve(camera.K.T, normal_cam) / distance, dtype=np.float64)


def median_depth(scene: Scene, instances: Sequence[Instance], planes: Sequence[Plane]) -> float:
    """The scene's scale: median depth of the elements' vertices on their planes, world unit; inf when none is seen."""
    depths = []
    for instance, plane in zip(instances, planes, strict=True):
        for key_frame, element in instance.members if plane.observable else ():
            region = scene.key_frames[key_frame].elements[element].amodal
            inverse = homogeneous(shapely.get_coordinates(region)) @ inverse_depth(
                plane, scene.frame_of(key_frame).camera
            )
            depths.append(1 / inverse[inverse > 0])
    found = np.concatenate(depths) if depths else np.empty(0)
    return float(np.median(found)) if len(found) else np.inf


def clip_to_plane(
    region: BaseGeometry, plane: Plane, camera: Camera, max_depth: float, min_horizon_px: float
) -> BaseGeometry:
    """The part of an image region (px) in which the plane lies in front of the camera, near and below its horizon.

    Inverse depth is linear in the image, so both limits are one half-plane. Clipping there, not in 3D, is what keeps
    pixels near the horizon from unprojecting to infinity.
    """
    inverse = inverse_depth(plane, camera)
    slope = float(np.hypot(inverse[0], inverse[1]))
    limit = max(1 / max_depth, min_horizon_px * slope)
    if region.is_empty or not np.isfinite(inverse).all():
        return Polygon()
    return region.intersection(half_plane(inverse - [0.0, 0.0, limit], region))


def unproject(points_px: FloatArray, plane: Plane, camera: Camera) -> FloatArray:
    """(N, 2) pixels → (N, 3) world points on the plane. The plane must lie in front of the camera at each of them."""
    depth = 1 / (homogeneous(points_px) @ inverse_depth(plane, camera))
    return camera.center_world + depth[:, None] * camera.rays_world(points_px)
