"""The edges of proposed outlines: what each is, how well it is known, and whether a person would leave it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely
from shapely import MultiPolygon

from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import homogeneous
from gtlayout.instances import Instance, Plane
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.line_sigma import contact_sigma, drawn_sigma, probability_within
from gtlayout.proposals.outlines import segments
from gtlayout.proposals.proposal import EdgeKind, ProposedEdge
from gtlayout.proposals.snapping import on_border
from gtlayout.scene import Camera, FloatArray

_SAMPLES = 9
"""Points of an edge that are looked at; not its ends, where others begin."""
_MOVED_PX = 1e-6
"""Corners that differ by less were not moved."""
LEFT: Mapping[EdgeKind, float] = {"contact": 1.0, "occlusion": 1.0, "side": 1.0, "open": 1.0, "border": 1.0}
"""Share of the edges of each kind that are left when their lines are known exactly: a corner may be elsewhere."""


@dataclass(frozen=True)
class Surroundings:
    """What the edges of one frame are judged by."""

    planes: Sequence[Plane]
    instances: Sequence[Instance]
    covariance: FloatArray
    """(4I, 4I) joint covariance of the planes."""
    camera: Camera
    outlines: Mapping[int, MultiPolygon]
    """Of all proposed elements by instance, px."""
    known: Sequence[MultiPolygon]
    """What was drawn of each instance, as it is seen here, px."""
    nearest: Mapping[int, Camera]
    """The camera nearest to this one in which an instance was drawn."""


def edges_of(instance: int, around: Surroundings, config: ProposalConfig) -> tuple[ProposedEdge, ...]:
    """The edges of one proposed outline."""
    return tuple(_edge(instance, points, around, config) for points in segments(around.outlines[instance]))


def with_snapped(edges: Sequence[ProposedEdge], outline: MultiPolygon) -> tuple[ProposedEdge, ...]:
    """The edges of an outline after it was snapped, corner by corner; those that moved say where they were."""
    moved = []
    for edge, points in zip(edges, segments(outline), strict=True):
        before = np.stack([edge.start_px, edge.end_px])
        at = replace(edge, start_px=points[0], end_px=points[1])
        moved.append(replace(at, unsnapped_px=before) if np.abs(points - before).max() > _MOVED_PX else at)
    return tuple(moved)


def _edge(instance: int, points: FloatArray, around: Surroundings, config: ProposalConfig) -> ProposedEdge:
    if on_border(points, around.camera):
        return ProposedEdge(points[0], points[1], "border", 0.0, LEFT["border"])
    scale = around.camera.annotation_scale
    kind, other, drawn = _kind(instance, points, around, config)
    sigmas = [np.inf]
    if kind == "contact" and other is not None:
        rows = np.r_[4 * instance : 4 * instance + 4, 4 * other : 4 * other + 4]
        covariance = around.covariance[np.ix_(rows, rows)]
        sigmas.append(contact_sigma((around.planes[instance], around.planes[other]), covariance, around.camera, points))
    if drawn is not None and drawn in around.nearest:
        sigmas.append(drawn_sigma(around.planes[drawn], around.nearest[drawn], around.camera, points))
    sigma = float(np.hypot(min(sigmas), config.drawing_sigma_px * scale))
    return ProposedEdge(
        points[0], points[1], kind, sigma, LEFT[kind] * probability_within(config.left_px * scale, sigma)
    )


def _kind(
    instance: int, points: FloatArray, around: Surroundings, config: ProposalConfig
) -> tuple[EdgeKind, int | None, int | None]:
    """What an edge is, the instance on its other side, and the one whose drawn outline it is; None = neither."""
    reach = config.same_border_px * around.camera.annotation_scale
    at = points[0] + np.linspace(0, 1, _SAMPLES + 2)[1:-1, None] * (points[1] - points[0])
    samples = shapely.points(at)

    def along(region: MultiPolygon) -> bool:
        return not region.is_empty and bool(shapely.dwithin(region.boundary, samples, reach).mean() >= 0.5)

    if around.instances[instance].host is not None:
        drawn = instance if along(around.known[instance]) else None
        return "open" if drawn is None else "side", None, drawn
    other = _beside(instance, samples, around, reach)
    if other is None:
        drawn = instance if along(around.known[instance]) else None
        return "open" if drawn is None else "side", None, drawn
    mine, others = (homogeneous(at) @ inverse_depth(around.planes[i], around.camera) for i in (instance, other))
    front = instance if np.median(mine - others) > 0 else other
    drawn = next((i for i in (front, instance, other) if along(around.known[i])), None)
    jump = np.median(np.abs(mine - others) / np.maximum(np.maximum(np.abs(mine), np.abs(others)), 1e-12))
    if jump <= config.prediction.min_depth_jump:
        return "contact", other, drawn
    # What hides ends where it was drawn to end; else it ends only because nothing was seen further.
    return ("occlusion", other, front) if drawn == front else ("open", other, None)


def _beside(instance: int, samples: npt.NDArray[np.object_], around: Surroundings, reach: float) -> int | None:
    """The instance, no opening, that lies along most of an edge on its other side; None where nothing does."""
    near = {
        i: int(shapely.dwithin(region, samples, reach).sum())
        for i, region in around.outlines.items()
        if i != instance and around.instances[i].host is None
    }
    best = max(near, key=lambda i: (near[i], -i), default=None)
    return best if best is not None and near[best] >= len(samples) / 2 else None
