"""What shows the bend of a wall: its tracks, and the lines along which it meets floors and ceilings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from gtlayout.curved.config import CurvedConfig
from gtlayout.edges import EdgeConfig, touching_points
from gtlayout.geometry.rays import depth_on_plane
from gtlayout.instances import Instance, Plane
from gtlayout.scene import FloatArray, IntArray, Scene
from gtlayout.tracking.triangulation import TriangulatedTracks


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
    if len(tracks) > config.max_tracks:
        tracks = tracks[np.linspace(0, len(tracks) - 1, config.max_tracks).round().astype(int)]
    rho = rays.rho[tracks]
    return WallEvidence(
        points=rays.center[tracks] + rays.ray[tracks] / rho[:, None],
        rays=rays.ray[tracks],
        depth=1 / rho,
        sigma_depth=rays.sigma_rho[tracks] / rho**2,
        key_frame=key_frame[tracks],
        feet=tuple(_feet(scene, instances, planes, index, edges, config)),
    )


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
            drawn = drawn[np.unique(np.linspace(0, len(drawn) - 1, config.edge_points).round().astype(int))]
            center, plane = camera.center_world, planes[level]

            def on_plane(px: FloatArray, camera=camera, center=center, plane=plane) -> tuple[FloatArray, FloatArray]:
                rays = camera.rays_world(px)
                depth = depth_on_plane(plane.normal @ center + plane.d, rays @ plane.normal)
                return center + depth[:, None] * rays, depth

            points, depth = on_plane(drawn)
            by_px = np.stack([on_plane(drawn + step)[0] - on_plane(drawn - step)[0] for step in 0.5 * np.eye(2)], 1)
            ahead = depth > 0
            if ahead.sum() >= 3:
                sigma_px = config.sigma_edge_px * camera.annotation_scale
                rays = camera.rays_world(drawn[ahead])
                found.append(Foot(level, center, rays, points[ahead], by_px[ahead], sigma_px))
    return found
