"""The edges of proposed outlines: what each is, how well it is known, and whether a person would leave it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import erf, sqrt

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import homogeneous
from gtlayout.instances import Instance, Plane, propagated_sigma
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.proposal import EdgeKind, ProposedEdge
from gtlayout.scene import Camera, FloatArray

_SAMPLES = 9
"""Points of an edge that are looked at, its ends left out: another edge begins there."""


@dataclass(frozen=True)
class Surroundings:
    """All that the edges of one frame are judged by."""

    planes: Sequence[Plane]
    instances: Sequence[Instance]
    covariance: FloatArray
    """(4I, 4I) joint covariance of the planes."""
    camera: Camera
    outlines: Mapping[int, MultiPolygon]
    """Of all proposed elements by instance, px."""


def edges_of(instance: int, around: Surroundings, config: ProposalConfig) -> tuple[ProposedEdge, ...]:
    """The edges of one proposed outline."""
    return tuple(_edge(instance, points, around, config) for points in segments(around.outlines[instance]))


def segments(region: MultiPolygon) -> Iterator[FloatArray]:
    """(2, 2) each edge of a region, ring by ring."""
    for polygon in region.geoms:
        for ring in (polygon.exterior, *polygon.interiors):
            points = shapely.get_coordinates(ring)
            for k in range(len(points) - 1):
                yield points[k : k + 2]


def probability_within(distance_px: float, sigma_px: float) -> float:
    """That a value with this σ lies within ``distance_px`` of zero."""
    return erf(distance_px / (sqrt(2) * max(sigma_px, 1e-9)))


def _edge(instance: int, points: FloatArray, around: Surroundings, config: ProposalConfig) -> ProposedEdge:
    scale = around.camera.annotation_scale
    kind, other = _kind(instance, points, around, config)
    if kind == "border":
        return ProposedEdge(points[0], points[1], kind, 0.0, 1.0)
    if kind == "open":
        return ProposedEdge(points[0], points[1], kind, np.inf, 0.0)
    own = (config.drawing_sigma_px * scale) ** 2
    sigma = sqrt(own + (_contact_sigma(instance, other, points, around) if other is not None else 0.0) ** 2)
    return ProposedEdge(points[0], points[1], kind, sigma, probability_within(config.left_px * scale, sigma))


def _kind(
    instance: int, points: FloatArray, around: Surroundings, config: ProposalConfig
) -> tuple[EdgeKind, int | None]:
    """What an edge is, and the instance that it touches, of a contact."""
    camera = around.camera
    reach = config.same_border_px * camera.annotation_scale
    at = points[0] + np.linspace(0, 1, _SAMPLES + 2)[1:-1, None] * (points[1] - points[0])
    to_border = np.minimum(at, [camera.width, camera.height] - at).min(axis=1)
    if np.median(to_border) <= 1.0:
        return "border", None
    if around.instances[instance].host is not None:
        return "side", None
    others = [j for j in around.outlines if j != instance and around.instances[j].host is None]
    samples = shapely.points(at)
    near = {j: int(shapely.dwithin(around.outlines[j], samples, reach).sum()) for j in others}
    other = max(near, key=lambda j: near[j], default=None)
    if other is None or near[other] < _SAMPLES / 2:
        return "open", None
    one, two = (homogeneous(at) @ inverse_depth(around.planes[i], camera) for i in (instance, other))
    jump = np.abs(one - two) / np.maximum(np.maximum(np.abs(one), np.abs(two)), 1e-12)
    if np.median(jump) > config.prediction.min_depth_jump:
        return "occlusion", None
    return "contact", other


def _contact_sigma(first: int, second: int, points: FloatArray, around: Surroundings) -> float:
    """σ of the line in which two planes meet, across an edge at its middle, px; from their joint covariance."""
    along = points[1] - points[0]
    normal = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    middle = points.mean(axis=0)
    pair = (first, second)
    rows = np.concatenate([np.arange(4 * i, 4 * i + 4) for i in pair])
    covariance = around.covariance[np.ix_(rows, rows)]
    difference = [inverse_depth(around.planes[i], around.camera) for i in pair]
    line = difference[0] - difference[1]
    # Moving a pixel across the line changes the difference of the inverse depths by so much.
    slope = float(line[:2] @ normal)
    gradient = np.concatenate(
        [
            sign * _inverse_depth_gradient(around.planes[i], around.camera, middle)
            for i, sign in zip(pair, (1, -1), strict=True)
        ]
    )
    if abs(slope) < 1e-15 or not np.isfinite(covariance).all():
        return np.inf
    return float(propagated_sigma(gradient, covariance)) / abs(slope)


def _inverse_depth_gradient(plane: Plane, camera: Camera, point_px: FloatArray) -> FloatArray:
    """(4,) d(1/z) / d(normal, normal · anchor + d) at a pixel; 1/z = −n·ray / (n·center + d)."""
    ray = camera.rays_world(point_px[None])[0]
    clearance = float(plane.normal @ camera.center_world) + plane.d
    inverse = -float(plane.normal @ ray) / clearance
    return -np.append(ray + inverse * (camera.center_world - plane.anchor), inverse) / clearance
