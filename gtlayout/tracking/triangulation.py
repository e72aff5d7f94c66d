"""Robust inverse depth of every track along its ray in the key frame it was sampled in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.scene import FloatArray, IntArray, Scene
from gtlayout.tracking.config import TriangulationConfig
from gtlayout.tracking.tracks import Tracks

_GRID = 50
"""Inverse depths tried on every track: each 1.3 times the one before, by default."""
_MOVED_SIGMAS = 3.0
"""A track shows parallax when a point at infinity explains it worse by so many σ."""


@dataclass(frozen=True)
class TriangulatedTracks:
    """Each track as a point at inverse depth ρ on a ray: ``X = center + ray / ρ``."""

    center: FloatArray
    """(N, 3) camera centre of the key frame."""
    ray: FloatArray
    """(N, 3) world direction with z = 1 in the key frame's camera."""
    key_px: FloatArray
    """(N, 2) the sampled pixel."""
    rho: FloatArray
    """(N,) inverse depth, 1 / world unit."""
    sigma_rho: FloatArray
    """(N,) its σ for independent observations; large at low parallax."""

    parallax_sigmas: FloatArray
    """(N,) σ between the observations and those of a point at infinity: below 3 the depth is not determined."""

    def points_world(self) -> FloatArray:
        """(N, 3) the triangulated points."""
        return self.center + self.ray / self.rho[:, None]

    def moved_share(self) -> float:
        """Share of the tracks that show parallax; NaN without tracks."""
        return float(np.mean(self.parallax_sigmas > _MOVED_SIGMAS)) if len(self.rho) else np.nan


def triangulate(scene: Scene, tracks: Tracks, config: TriangulationConfig) -> TriangulatedTracks:
    """Minimise a Cauchy loss of the reprojection errors over inverse depth, for all tracks at once.

    The key frame's own point defines the ray. A grid over inverse depth finds the right basin (a slide or a repeated
    pattern makes several), Gauss-Newton on the re-weighted residuals polishes it.
    """
    path = camera_path(scene) or 1.0
    depth_range = config.depth_range_paths[0] * path, config.depth_range_paths[1] * path
    key_camera_of = [scene.frame_of(k).camera for k in range(len(scene.key_frames))]
    first = np.searchsorted(tracks.track, np.arange(len(tracks)))
    at_key = np.array([key_frame.frame for key_frame in scene.key_frames])[tracks.key_frame]
    is_key = tracks.frame == at_key[tracks.track]
    key_px = np.empty((len(tracks), 2))
    key_px[tracks.track[is_key]] = tracks.points_px[is_key]
    center, ray = np.empty((len(tracks), 3)), np.empty((len(tracks), 3))
    for k, camera in enumerate(key_camera_of):
        sampled = tracks.key_frame == k
        center[sampled] = camera.center_world
        ray[sampled] = camera.rays_world(key_px[sampled])

    far, slope = _projection(scene, tracks, center, ray)
    sigma_px = tracks.sigma_px[tracks.track]
    scale_px = config.cauchy * sigma_px
    rho = _best_on_grid(tracks, far, slope, scale_px, first, depth_range)
    for _ in range(10):
        residual, jacobian = _reprojection(tracks, far, slope, rho[tracks.track])
        weight = 1.0 / (1.0 + np.sum(residual**2, axis=0) / scale_px**2)
        gradient = np.add.reduceat(weight * np.sum(residual * jacobian, axis=0), first)
        curvature = np.add.reduceat(weight * np.sum(jacobian**2, axis=0), first)
        step = gradient / np.maximum(curvature, 1e-12)
        rho = np.clip(rho - step, 1.0 / depth_range[1], 1.0 / depth_range[0])
    gain = _cost(tracks, far, slope, 0.0, scale_px, first) - _cost(
        tracks, far, slope, rho[tracks.track], scale_px, first
    )
    # Without parallax it is only known that the depth is not small. The result must not depend on its upper limit.
    least, most = np.median(rho) / np.flip(config.depth_range_medians) if len(rho) else (0.0, np.inf)
    return TriangulatedTracks(
        center=center,
        ray=ray,
        key_px=key_px,
        rho=np.clip(rho, least, most),
        sigma_rho=tracks.sigma_px / np.sqrt(np.maximum(curvature, 1e-12)),
        # Near zero the loss is r² / scale², so this is the root of a difference of χ².
        parallax_sigmas=config.cauchy * np.sqrt(np.maximum(gain, 0.0)),
    )


def parallax_deg(scene: Scene, tracks: Tracks, rays: TriangulatedTracks) -> FloatArray:
    """(N,) largest angle at which two of a track's cameras see its triangulated point, degrees."""
    centers = np.array([frame.camera.center_world for frame in scene.frames])
    towards = centers[tracks.frame] - rays.points_world()[tracks.track]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    last = np.cumsum(np.bincount(tracks.track, minlength=len(tracks)))
    cosine = [(seen @ seen.T).min() for seen in np.split(towards, last[:-1])] if len(tracks) else []
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def camera_path(scene: Scene) -> float:
    """Diagonal of the box that holds all camera centres, world unit; 0 when the camera does not move."""
    centers = np.array([frame.camera.center_world for frame in scene.frames])
    extent = float(np.linalg.norm(np.ptp(centers, axis=0)))
    return extent if extent > 1e-9 * float(np.abs(centers).max()) else 0.0


def reprojection_px(scene: Scene, tracks: Tracks, rays: TriangulatedTracks) -> FloatArray:
    """(M, 2) where each observation's point projects to, minus where it was seen."""
    far, slope = _projection(scene, tracks, rays.center, rays.ray)
    residual, _ = _reprojection(tracks, far, slope, rays.rho[tracks.track])
    return residual.T


def _projection(scene: Scene, tracks: Tracks, center: FloatArray, ray: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Per observation the homogeneous image of ``center + ray / ρ`` is ``far + ρ slope``: (3, M) each.

    Rows of coordinates, here and below: sums of two or three numbers each take NumPy many times as long.
    """
    far, slope = np.empty((3, len(tracks.track))), np.empty((3, len(tracks.track)))
    order = np.argsort(tracks.frame, kind="stable")
    frames, start = np.unique(tracks.frame[order], return_index=True)
    for frame, seen in zip(frames.tolist(), np.split(order, start)[1:], strict=True):
        camera = scene.frames[frame].camera
        index = tracks.track[seen]
        far[:, seen] = (ray[index] @ (camera.K @ camera.R_cam_from_world).T).T
        slope[:, seen] = ((center[index] @ camera.R_cam_from_world.T + camera.t_cam_from_world) @ camera.K.T).T
    return far, slope


def _reprojection(tracks: Tracks, far: FloatArray, slope: FloatArray, rho: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(2, M) residuals in px and their (2, M) derivatives with respect to ρ."""
    projected, depth = _image(far, slope, rho)
    return projected - tracks.points_px.T, (slope[:2] - projected * slope[2]) / depth


def _image(far: FloatArray, slope: FloatArray, rho: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """(2, M) pixels of the observations at (M,) inverse depths, or one for all, and (M,) the divisors they have."""
    homogeneous = far + rho * slope
    depth = np.where(np.abs(homogeneous[2]) < 1e-9, 1e-9, homogeneous[2])
    return homogeneous[:2] / depth, depth


def _cost(
    tracks: Tracks, far: FloatArray, slope: FloatArray, rho: FloatArray | float, scale_px: FloatArray, first: IntArray
) -> FloatArray:
    """(N,) Cauchy loss of each track at inverse depth ρ, in units of its scale squared: Σ log(1 + r² / scale²).

    ρ is (M,), of each observation, or one for all.
    """
    projected, _ = _image(far, slope, rho)
    residual = projected - tracks.points_px.T
    cost: FloatArray = np.add.reduceat(np.log1p(np.sum(residual**2, axis=0) / scale_px**2), first)
    return cost


def _best_on_grid(
    tracks: Tracks,
    far: FloatArray,
    slope: FloatArray,
    scale_px: FloatArray,
    first: IntArray,
    depth_range: tuple[float, float],
) -> FloatArray:
    best_cost = np.full(len(tracks), np.inf)
    best = np.full(len(tracks), 1.0 / depth_range[1])
    for candidate in np.geomspace(1.0 / depth_range[1], 1.0 / depth_range[0], _GRID):
        cost = _cost(tracks, far, slope, candidate, scale_px, first)
        better = cost < best_cost
        best_cost[better], best[better] = cost[better], candidate
    return best
