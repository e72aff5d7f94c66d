"""The part of an extent whose depth is known: an extent ends where its plane is too uncertain.

Seen from a camera at distance D from a plane, the σ of depth as a share of the depth is σ / D at every point, with σ
that of the plane's position along its normal there. σ² is a quadratic of the place on the plane, so the places with σ
up to some limit are an ellipse.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.extent.config import ExtentConfig
from gtlayout.geometry.raster import spread_points
from gtlayout.instances import Plane, PlaneFrame
from gtlayout.scene import Camera, FloatArray

_SAMPLES = 100
"""Points of a region among which the one with the least σ is found."""
_CORNERS = 64
"""Corners of the polygon within an ellipse: it covers all but .2 % of its area."""
_FLAT = 1e-9
"""σ² is taken to change over a region by at least this share of its limit: no ellipse is endless."""
_STENCIL = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1]], dtype=np.float64)


def known_part(
    region: MultiPolygon, plane: Plane, frame: PlaneFrame, cameras: Sequence[Camera], config: ExtentConfig
) -> BaseGeometry:
    """The part of a region, in ``frame``, whose depth is known well enough from the camera farthest off the plane.

    The region itself when that is all of it, and where σ is not known.
    """
    if region.is_empty or not cameras:
        return region
    at_vertices, within = (
        plane.sigma_offset(frame.to_world(uv))
        for uv in (shapely.get_coordinates(region), spread_points(region, _SAMPLES))
    )
    least = float(min(at_vertices.min(), within.min()))
    distance = max(abs(float(plane.normal @ camera.center_world) + plane.d) for camera in cameras)
    limit = max(config.max_sigma_depth_share * distance, config.max_sigma_growth * least)
    # The ellipse is convex: a region with all vertices in it is in it.
    return region.intersection(_ellipse(plane, frame, limit, region)) if (at_vertices > limit).any() else region


def _ellipse(plane: Plane, frame: PlaneFrame, limit: float, around: BaseGeometry) -> Polygon:
    """A polygon within the ellipse, in ``frame``, on which the plane's σ along its normal is at most ``limit``.

    ``limit`` must be more than the least σ in ``around``, whose size is the unit that the quadratic is found in.
    """
    low, high = np.reshape(around.bounds, (2, 2))
    middle, size = (low + high) / 2, float((high - low).max()) / 2
    at, right, left, up, down, corner = plane.sigma_offset(frame.to_world(middle + size * _STENCIL)) ** 2
    gradient = np.array([right - left, up - down]) / 2
    square = np.array([right + left, up + down]) / 2 - at
    mixed = (corner - at - gradient.sum() - square.sum()) / 2
    curvature, directions = np.linalg.eigh([[square[0], mixed], [mixed, square[1]]])
    curvature = np.maximum(curvature, _FLAT * limit**2)
    slope = directions.T @ gradient
    centre = -slope / (2 * curvature)
    least = at + slope @ centre / 2
    radii: FloatArray = np.sqrt((limit**2 - least) / curvature)
    angle = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    # By the symmetric root of the curvature: signs and order of eigenvectors differ from one CPU to another.
    ring = centre + radii * (np.column_stack([np.cos(angle), np.sin(angle)]) @ directions)
    return Polygon(middle + size * ring @ directions.T)
