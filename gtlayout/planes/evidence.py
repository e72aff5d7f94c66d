"""Stage 4, before the graph: tracks, edges and right angles of each instance, in a normalised world."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gtlayout.camera_errors.camera_response import CameraResponse
from gtlayout.edges import ContactEdge
from gtlayout.geometry.raster import spread_points
from gtlayout.geometry.rays import depth_on_plane, inverse_depth_on_plane
from gtlayout.instances import Instance
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.edge_group import EdgeGroup
from gtlayout.planes.views import Views
from gtlayout.prepared.measurements import Measurements
from gtlayout.scene import BoolArray, Camera, FloatArray, IntArray, Scene
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks

_VIEW_POINTS = 12
"""Pixels sampled on each element of an instance."""
_ROUNDING_PX = 1e-6


@dataclass(frozen=True)
class Evidence:
    """Everything that is measured about the planes of S instances. Local world."""

    rays: TriangulatedTracks
    """Every track as a point at inverse depth on a ray."""
    sigma_rho: FloatArray
    """(N,) σ of the inverse depths, with the errors that all points have in common."""
    track_instance: IntArray
    """(N,) instance of each track; -1 = not used."""
    track_key_frame: IntArray
    """(N,) key frame each track was sampled in."""
    track_weight: FloatArray
    """(N,) how far each track is trusted before its residual is known, in [0, 1]."""
    edges: tuple[EdgeGroup, ...]
    perpendicular: BoolArray
    """(S, S) whether two instances should be at right angles: walls and floors or ceilings."""
    level: BoolArray
    """(S,) floors and ceilings."""
    wall: BoolArray
    """(S,) walls."""
    views: tuple[Views, ...]
    camera_response: CameraResponse
    """What the cameras may be wrong by, and what that does to the tracks."""
    host: IntArray
    """(S,) for doors and windows the instance they lie in; -1 for all others."""

    @cached_property
    def contacts(self) -> tuple[tuple[int, int], ...]:
        """The pairs of instances that have a contact edge in any key frame, the smaller number first."""
        return tuple(sorted({group.instances for group in self.edges}))

    @cached_property
    def typical_rho(self) -> float:
        """Median inverse depth of all tracks."""
        return float(np.median(self.rays.rho))

    @cached_property
    def touching(self) -> BoolArray:
        """(S, S) whether two instances have a contact edge in any key frame."""
        pairs = np.zeros_like(self.perpendicular)
        for group in self.edges:
            a, b = group.instances
            pairs[a, b] = pairs[b, a] = True
        return pairs

    def without(self, pairs: Collection[tuple[int, int]]) -> Evidence:
        """The same without the contact edges of these pairs of instances, the smaller number first."""
        return replace(self, edges=tuple(group for group in self.edges if group.instances not in pairs))

    def on_planes(self, index: IntArray, planes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n, 3) points where the tracks' rays meet planes, (4,) for all or (n, 4) one each, and (n,) depths there."""
        center, ray = self.rays.center[index], self.rays.ray[index]
        facing = np.sum(planes[..., :3] * ray, axis=1)
        clearance = np.sum(planes[..., :3] * center, axis=1) + planes[..., 3]
        depth = depth_on_plane(clearance, facing)
        return center + depth[:, None] * ray, depth

    def tracks_of(self, instance: int, max_weight: float) -> tuple[IntArray, float]:
        """(n,) the tracks of an instance, and one weight for all of them, 0 without tracks.

        It is the mean of their weights, whose sum is limited to ``max_weight`` times the number of key frames.
        """
        index = np.nonzero(self.track_instance == instance)[0]
        if len(index) == 0:
            return index, 0.0
        total = float(self.track_weight[index].sum())
        return index, min(total, max_weight * len(np.unique(self.track_key_frame[index]))) / len(index)

    def track_residuals(self, index: IntArray, planes: FloatArray) -> FloatArray:
        """(H, n) deviation of the tracks' inverse depths from those of (H, 4) planes, in σ."""
        facing = planes[:, :3] @ self.rays.ray[index].T
        clearance = planes[:, :3] @ self.rays.center[index].T + planes[:, 3:]
        on_plane = inverse_depth_on_plane(clearance, facing)
        residuals: FloatArray = (self.rays.rho[index] - on_plane) / self.sigma_rho[index]
        return residuals

    def relative_sigma(self, index: IntArray, residual: FloatArray) -> FloatArray:
        """(n,) σ of inverse depths as a share of the plane's, for tracks of (n,) ``residual``."""
        on_plane = self.rays.rho[index] - residual * self.sigma_rho[index]
        return self.sigma_rho[index] / np.maximum(on_plane, 1e-3)


def gather(measured: Measurements, local: Normalisation, config: EstimationConfig) -> Evidence:
    """Collect the evidence on every instance."""
    scene, tracks, instances, rays = measured.scene, measured.tracks, measured.instances, local.rays(measured.rays)
    key_cameras = [local.camera(scene.frame_of(k).camera) for k in range(len(scene.key_frames))]
    track_instance = _thin_out(prefer_visible(scene, tracks, measured.track_instance), config.max_tracks)
    host = np.array([-1 if instance.host is None else instance.host for instance in instances])
    labels = [instance.label for instance in instances]
    level = np.array([label in ("floor", "ceiling") for label in labels])
    wall = np.array([label == "wall" for label in labels])
    across = np.outer(wall, level)
    response = measured.camera_response or CameraResponse.none(len(tracks), len(scene.key_frames))
    return Evidence(
        rays=rays,
        sigma_rho=np.hypot(rays.sigma_rho, config.relative_depth_sigma * rays.rho),
        track_instance=track_instance,
        track_key_frame=tracks.key_frame,
        track_weight=_trust(scene, tracks, track_instance, instances, config),
        edges=_edge_groups(measured.edges, host, key_cameras, config.min_edge_px),
        perpendicular=across | across.T,
        level=level,
        wall=wall,
        views=tuple(_views(scene, instance, key_cameras) for instance in instances),
        camera_response=replace(response, center=local.scale * response.center),
        host=host,
    )


def prefer_visible(scene: Scene, tracks: Tracks, track_instance: IntArray) -> IntArray:
    """(N,) instances of tracks. -1 for those sampled on an amodal polygon, which may be on furniture, where their
    instance has tracks on visible parts.
    """
    drawn = np.array(
        [
            not scene.key_frames[k].elements[e].visible.is_empty
            for k, e in zip(tracks.key_frame, tracks.element, strict=True)
        ],
        dtype=bool,
    )
    with_visible = np.unique(track_instance[drawn])
    return np.where(drawn | ~np.isin(track_instance, with_visible), track_instance, -1)


def _thin_out(track_instance: IntArray, most: int) -> IntArray:
    """At most this many tracks of each instance, evenly over key frames and places. The others are not used."""
    thinned = track_instance.copy()
    for instance in np.unique(track_instance[track_instance >= 0]):
        index = np.nonzero(track_instance == instance)[0]
        if len(index) > most:
            thinned[index] = -1
            thinned[index[np.linspace(0, len(index) - 1, most).round().astype(int)]] = instance
    return thinned


def _trust(
    scene: Scene,
    tracks: Tracks,
    track_instance: IntArray,
    instances: Sequence[Instance],
    config: EstimationConfig,
) -> FloatArray:
    """(N,) weight of each track by its length and by how well its instance can be tracked.

    Points on mirror-like surfaces triangulate well, but at wrong depths, and few of them survive. So an instance is
    trusted by the share of its points that survive.
    """
    kept, tried = np.array([followed(scene, tracks, instance) for instance in instances]).T
    survival = np.minimum(kept / np.maximum(tried, 1) / config.full_survival, 1.0)
    plenty = np.minimum(kept / config.full_tracks, 1.0)
    observations = np.bincount(tracks.track, minlength=len(tracks))
    # The graph has at most this many observations of a track. They share the errors of tracking and of the cameras.
    length = np.minimum(1.0, config.independent_observations / np.minimum(observations, config.max_observations))
    weight: FloatArray = length * np.where(track_instance >= 0, (survival * plenty)[track_instance], 0.0)
    return weight


def followed(scene: Scene, tracks: Tracks, instance: Instance) -> tuple[int, int]:
    """How many of the points sampled on an instance could be followed, and how many there were.

    As in ``prefer_visible``, points on elements without visible parts count only where there are no others.
    """
    visible = [(k, e) for k, e in instance.members if not scene.key_frames[k].elements[e].visible.is_empty]
    members = visible or instance.members
    kept = sum(int(np.count_nonzero((tracks.key_frame == k) & (tracks.element == e))) for k, e in members)
    return kept, sum(int(tracks.tried[k][e]) for k, e in members)


def _edge_groups(
    edges: Sequence[ContactEdge], host: IntArray, key_cameras: Sequence[Camera], min_length_px: float
) -> tuple[EdgeGroup, ...]:
    """The contact edges whose planes meet in a line: not those between an opening and its host, or within one host."""
    root = np.where(host >= 0, host, np.arange(len(host)))
    # Samples are whole steps apart, so many edges have exactly the least length, up to rounding.
    least_px = [min_length_px * camera.annotation_scale - _ROUNDING_PX for camera in key_cameras]
    return tuple(
        EdgeGroup(
            key_cameras[edge.key_frame],
            (min(edge.instances), max(edge.instances)),
            edge.points_px,
            key_frame=edge.key_frame,
        )
        for edge in edges
        if root[edge.instances[0]] != root[edge.instances[1]]
        and np.linalg.norm(np.ptp(edge.points_px, axis=0)) >= least_px[edge.key_frame]
    )


def _views(scene: Scene, instance: Instance, key_cameras: Sequence[Camera]) -> Views:
    """A few pixels spread over every element of an instance."""
    centers, rays = [np.empty((0, 3))], [np.empty((0, 3))]
    for k, element in instance.members:
        drawn = scene.key_frames[k].elements[element]
        points_px = spread_points(drawn.amodal if drawn.visible.is_empty else drawn.visible, _VIEW_POINTS)
        rays.append(key_cameras[k].rays_world(points_px))
        centers.append(np.broadcast_to(key_cameras[k].center_world, (len(points_px), 3)))
    return Views(np.concatenate(centers), np.concatenate(rays))
