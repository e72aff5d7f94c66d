"""What shows the bend of a wall: its tracks, and the lines along which it meets floors and ceilings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from gtlayout.curved.config import CurvedConfig
from gtlayout.edges import EdgeConfig, touching_points
from gtlayout.geometry.plane_image import inverse_depth, unproject
from gtlayout.geometry.polygons import homogeneous
from gtlayout.instances import Instance, Plane
from gtlayout.scene import Camera, FloatArray, IntArray, Scene
from gtlayout.tracking.triangulation import TriangulatedTracks

_HALF_PX = 0.5 * np.eye(2)
_LEAST_POINTS = 3
"""Fewer points of a foot show no bend."""


@dataclass(frozen=True)
class Foot:
    """The line along which a wall meets a floor or ceiling in one key frame."""

    level: int
    """Index of the floor or ceiling."""
    center: FloatArray
    """(3,) the camera."""
    rays: FloatArray
    """(n, 3) through the drawn points."""
    points: FloatArray
    """(n, 3) where they meet the plane."""
    by_px: FloatArray
    """(n, 2, 3) how far these move for each pixel in the image."""
    sigma_px: float
    bend_px: float
    """How far the drawn points are from a line of their own, RMS."""


@dataclass(frozen=True)
class WallEvidence:
    """Of one wall. World unit."""

    points: FloatArray
    """(N, 3) triangulated tracks."""
    rays: FloatArray
    """(N, 3) along which their error lies, with z = 1 in the key frame's camera."""
    depth: FloatArray
    """(N,) along z in that camera."""
    sigma_depth: FloatArray
    """(N,) of independent errors."""
    key_frame: IntArray
    """(N,) in which each was sampled."""
    feet: tuple[Foot, ...]

    def weights(self, most: float) -> FloatArray:
        """(N,) of the tracks, whose sum over a key frame is ``most`` at most."""
        count = np.bincount(self.key_frame)[self.key_frame]
        return np.minimum(1.0, most / count)

    def thinned(self, most: int) -> WallEvidence:
        """With at most so many tracks."""
        kept = _spread(len(self.points), most)
        by_track = {name: getattr(self, name)[kept] for name in ("points", "rays", "depth", "sigma_depth", "key_frame")}
        return replace(self, **by_track)


def evidence_of(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    index: int,
    rays: TriangulatedTracks,
    tracks: IntArray,
    key_frame: IntArray,
    edges: EdgeConfig,
    config: CurvedConfig,
) -> WallEvidence:
    """The evidence on wall ``index``, from ``tracks``, the (n,) numbers of its own among all (N,) ``rays``.

    ``key_frame`` (N,) is that in which each track was sampled.
    """
    tracks = tracks[_spread(len(tracks), config.max_tracks)]
    rho = rays.rho[tracks]
    return WallEvidence(
        points=rays.center[tracks] + rays.ray[tracks] / rho[:, None],
        rays=rays.ray[tracks],
        depth=1 / rho,
        sigma_depth=rays.sigma_rho[tracks] / rho**2,
        key_frame=key_frame[tracks],
        feet=tuple(_feet(scene, instances, planes, index, edges, config)),
    )


def _spread(count: int, most: int) -> IntArray:
    """Indices of at most so many of a number of things, evenly."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)


def _feet(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    index: int,
    edges: EdgeConfig,
    config: CurvedConfig,
) -> list[Foot]:
    members = dict(instances[index].members)
    found = []
    for level, other in enumerate(instances):
        if other.label not in ("floor", "ceiling") or not planes[level].observable:
            continue
        for k, element in other.members:
            if k not in members:
                continue
            camera = scene.frame_of(k).camera
            own = EdgeConfig(*(value * camera.annotation_scale for value in astuple(edges)))
            drawn = touching_points(scene.key_frames[k], camera, (members[k], element), own)
            if len(drawn) * own.step_px < config.min_edge_px * camera.annotation_scale:
                continue
            # In order of the image, so that thinning keeps all of the line.
            drawn = drawn[np.lexsort((drawn[:, 1], drawn[:, 0]))]
            drawn = drawn[_spread(len(drawn), config.edge_points)]
            drawn = drawn[homogeneous(drawn) @ inverse_depth(planes[level], camera) > 0]
            if len(drawn) >= _LEAST_POINTS:
                found.append(_foot(drawn, level, planes[level], camera, config))
    return found


def _foot(drawn: FloatArray, level: int, plane: Plane, camera: Camera, config: CurvedConfig) -> Foot:
    """From (n, 2) px on the plane."""
    moved = [unproject(drawn + step, plane, camera) - unproject(drawn - step, plane, camera) for step in _HALF_PX]
    return Foot(
        level,
        camera.center_world,
        camera.rays_world(drawn),
        unproject(drawn, plane, camera),
        np.stack(moved, axis=1),
        config.sigma_edge_px * camera.annotation_scale,
        float(np.linalg.svd(drawn - drawn.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(drawn))),
    )
