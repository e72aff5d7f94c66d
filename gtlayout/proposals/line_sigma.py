"""How well the place of a line in an image is known: across it, px, from the joint covariance of the planes."""

from __future__ import annotations

from math import erf, sqrt

import numpy as np

from gtlayout.geometry.depth import sigma_depth
from gtlayout.geometry.plane_image import inverse_depth, unproject
from gtlayout.instances import Plane, propagated_sigma
from gtlayout.scene import Camera, FloatArray

_LEAST = 1e-15
"""Of the change of the difference of two inverse depths a pixel; below it two planes do not meet."""


def contact_sigma(planes: tuple[Plane, Plane], covariance: FloatArray, camera: Camera, points_px: FloatArray) -> float:
    """σ of the line in which two planes meet, at the middle of its piece (2, 2) px; infinite where they do not.

    There both inverse depths are equal: moving across the line by a pixel changes their difference by the slope, and σ
    of the difference over the slope is σ of the line.

    Args:
        planes: The two.
        covariance: (8, 8) joint covariance of their (normal, normal · anchor + d).
        camera: Whose image it is.
        points_px: The ends of the piece.
    """
    across = _across(points_px)
    middle = points_px.mean(axis=0)
    difference = inverse_depth(planes[0], camera) - inverse_depth(planes[1], camera)
    slope = abs(float(difference[:2] @ across))
    first, second = (_inverse_depth_gradient(plane, camera, middle) for plane in planes)
    if not (slope > _LEAST and np.isfinite(covariance).all()):
        return np.inf
    return float(propagated_sigma(np.concatenate([first, -second]), covariance)) / slope


def drawn_sigma(plane: Plane, drawn_in: Camera, camera: Camera, points_px: FloatArray) -> float:
    """σ of a line (2, 2) px that was drawn on a plane in another image, at its middle, by σ of the depth there."""
    point = unproject(points_px.mean(axis=0)[None], plane, camera)
    other_px, _ = drawn_in.project(point)
    sigma, _ = sigma_depth(plane, drawn_in, other_px)
    (here, moved), depths = camera.project(
        np.concatenate([point, point + sigma[:, None] * drawn_in.rays_world(other_px)])
    )
    if not (np.isfinite(moved).all() and depths.min() > 0):
        return np.inf
    return abs(float((moved - here) @ _across(points_px)))


def probability_within(distance_px: float, sigma_px: float) -> float:
    """That a normal error of this σ is at most ``distance_px``."""
    return erf(distance_px / (sqrt(2) * sigma_px)) if sigma_px > 0 else 1.0


def _across(points_px: FloatArray) -> FloatArray:
    along = points_px[1] - points_px[0]
    return np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)


def _inverse_depth_gradient(plane: Plane, camera: Camera, point_px: FloatArray) -> FloatArray:
    """(4,) of 1/z = −n·ray / (n·center + d) at a pixel by (normal, normal · anchor + d)."""
    ray = camera.rays_world(point_px[None])[0]
    clearance = float(plane.normal @ camera.center_world) + plane.d
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = -np.float64(plane.normal @ ray) / clearance
        return np.asarray(-np.append(ray + inverse * (camera.center_world - plane.anchor), inverse) / clearance)
