"""A plane as a camera sees it: the one place in which rays meet planes."""

from __future__ import annotations

import numpy as np
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.polygons import cut, homogeneous
from gtlayout.instances import Plane
from gtlayout.scene import Camera, FloatArray


def inverse_depth(plane: Plane, camera: Camera) -> FloatArray:
    """(3,) coefficients (a, b, c) of the plane's inverse depth in the image: 1/z = a x + b y + c at pixel (x, y).

    It is zero on the horizon and negative where the pixel's ray misses the plane. Infinite when the camera lies on it.
    """
    normal_cam = camera.R_cam_from_world @ plane.normal
    distance = float(plane.normal @ camera.center_world) + plane.d
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-np.linalg.solve(camera.K.T, normal_cam) / distance, dtype=np.float64)


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
    return cut(region, inverse - [0.0, 0.0, limit])


def unproject(points_px: FloatArray, plane: Plane, camera: Camera) -> FloatArray:
    """(N, 2) pixels → (N, 3) world points on the plane. The plane must lie in front of the camera at each of them."""
    depth = 1 / (homogeneous(points_px) @ inverse_depth(plane, camera))
    return camera.center_world + depth[:, None] * camera.rays_world(points_px)
