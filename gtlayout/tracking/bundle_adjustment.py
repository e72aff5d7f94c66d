"""Between stages 1 and 2, on demand: bundle adjustment of the cameras with the tracks, kept where it is better.

Variables are a ``Pose3`` per frame with observations and a ``Point3`` per track. The given poses are priors: they fix
the world frame and its scale, and what the tracks do not determine does not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X
from scipy.spatial.transform import Rotation

from gtlayout.figures import figure
from gtlayout.scene import BoolArray, Camera, FloatArray, IntArray, Scene
from gtlayout.tracking.config import CameraRefinementConfig, TriangulationConfig
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks, spread_observations
from gtlayout.tracking.triangulation import TriangulatedTracks, camera_path, reprojection_px, triangulate


@dataclass(frozen=True)
class CameraReport:
    """Whether the cameras were refined, and the figures that decided it. NaN where they were not reached."""

    kept_because: str = ""
    """Why the given cameras stay; empty when they were refined."""
    rotation_deg: float = np.nan
    """Median turn of the cameras that moved."""
    shift: float = np.nan
    """Median shift of their centres, world unit."""
    given_px: float = np.nan
    """Median reprojection error, with the given cameras, of tracks that the refinement did not use."""
    refined_px: float = np.nan
    """The same with the cameras that were refined without these tracks."""

    @property
    def refined(self) -> bool:
        """Whether the scene has new cameras."""
        return not self.kept_because


def refine_cameras(
    scene: Scene,
    tracks: Tracks,
    rays: TriangulatedTracks,
    config: CameraRefinementConfig,
    triangulation: TriangulationConfig,
    seed: int,
) -> tuple[Scene, CameraReport]:
    """The scene with refined camera poses, or unchanged when they are not clearly better.

    The cameras are refined on a part of the tracks first. If the others, triangulated again, reproject clearly
    better than with the given cameras, the refinement is repeated with all tracks and kept. In the same way they decide
    whether the given poses are trusted less. Frames without a track keep their pose. ``rays`` are of the given
    cameras; triangulate again afterwards. Deterministic in ``seed``.
    """
    if camera_path(scene) == 0.0 or rays.moved_share() < config.min_moved_share:
        return scene, CameraReport("the camera hardly moves")
    order = np.random.default_rng(seed).permutation(len(tracks))[: config.max_tracks]
    held_out, fitted = np.split(order, [round(config.held_out_share * len(order))])
    if len(held_out) < config.min_held_out:
        return scene, CameraReport(f"only {len(order)} points could be tracked")
    given_cost, given_px = _misfit(scene, tracks, rays, held_out)
    best_cost, best_px, prior_scale = given_cost, given_px, 0.0
    min_gain = config.min_gain
    for tried in (1.0, *config.looser_factors):
        trial = _adjusted(scene, tracks, rays, fitted, tried, config)
        cost, px = _misfit(trial, tracks, triangulate(trial, tracks, triangulation), held_out)
        if cost > (1 - min_gain) * best_cost:
            break
        best_cost, best_px, prior_scale, min_gain = cost, px, tried, config.min_gain_looser
    if prior_scale == 0.0:
        reason = f"points it did not see lie {figure(given_px, 2, ' px')} off before and {figure(px, 2, ' px')} after"
        return scene, CameraReport(reason, given_px=given_px, refined_px=px)
    refined = _adjusted(scene, tracks, rays, order, prior_scale, config)
    turns_deg, shifts = _moved(scene, refined, np.unique(tracks.frame[np.isin(tracks.track, order)]))
    return refined, CameraReport("", float(np.median(turns_deg)), float(np.median(shifts)), given_px, best_px)


def _adjusted(
    scene: Scene,
    tracks: Tracks,
    rays: TriangulatedTracks,
    used: IntArray,
    prior_scale: float,
    config: CameraRefinementConfig,
) -> Scene:
    """The scene with the cameras that explain the ``used`` tracks best.

    ``prior_scale`` is a factor on σ of the given poses.
    """
    local = Normalisation.of(rays)
    cameras = [local.camera(frame.camera) for frame in scene.frames]
    observed = np.isin(tracks.track, used) & spread_observations(tracks, config.max_observations)
    graph, values = _graph(cameras, tracks, local.rays(rays), observed, prior_scale, config)
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(config.max_iterations)
    params.setRelativeErrorTol(config.relative_decrease)
    optimum = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    frames = list(scene.frames)
    for f in np.unique(tracks.frame[observed]).tolist():
        pose = optimum.atPose3(X(f))
        center = local.points_to_world(pose.translation())
        frames[f] = replace(frames[f], camera=frames[f].camera.placed(pose.rotation().matrix().T, center))
    return replace(scene, frames=tuple(frames))


def _graph(
    cameras: Sequence[Camera],
    tracks: Tracks,
    rays: TriangulatedTracks,
    observed: BoolArray,
    prior_scale: float,
    config: CameraRefinementConfig,
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Bundle adjustment in the local world, native factors only, and where it starts."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel
    sigmas = [*3 * [np.deg2rad(config.sigma_rotation_deg)], *3 * [config.sigma_position]]
    as_given = noise.Diagonal.Sigmas(prior_scale * np.array(sigmas))
    intrinsics = {}
    for f in np.unique(tracks.frame[observed]).tolist():
        camera, K = cameras[f], cameras[f].K
        intrinsics[f] = gtsam.Cal3_S2(K[0, 0], K[1, 1], K[0, 1], K[0, 2], K[1, 2])
        pose = gtsam.Pose3(gtsam.Rot3(camera.R_cam_from_world.T), camera.center_world)
        values.insert(X(f), pose)
        graph.add(gtsam.PriorFactorPose3(X(f), pose, as_given))
    points, depth = rays.points_world(), 1 / rays.rho
    models = {}
    cauchy = noise.mEstimator.Cauchy.Create(config.cauchy)
    for n in np.unique(tracks.track[observed]).tolist():
        sigma_px = config.sigma_factor * float(tracks.sigma_px[n])
        models[n] = noise.Robust.Create(cauchy, noise.Isotropic.Sigma(2, sigma_px))
        values.insertPoint3(L(n), points[n])
        # A track without parallax has no depth: this keeps the system regular.
        weak_prior = noise.Isotropic.Sigma(3, config.sigma_point_depths * float(depth[n]))
        graph.add(gtsam.PriorFactorPoint3(L(n), points[n], weak_prior))
    for n, f, point_px in zip(
        tracks.track[observed].tolist(), tracks.frame[observed].tolist(), tracks.points_px[observed], strict=True
    ):
        graph.add(gtsam.GenericProjectionFactorCal3_S2(point_px, models[n], X(f), L(n), intrinsics[f]))
    return graph, values


def _misfit(scene: Scene, tracks: Tracks, rays: TriangulatedTracks, chosen: IntArray) -> tuple[float, float]:
    """Mean robust cost and median error, px, of the ``chosen`` tracks' observations outside their key frames."""
    errors_px = np.linalg.norm(reprojection_px(scene, tracks, rays), axis=1)
    key_frames = np.array([key_frame.frame for key_frame in scene.key_frames])[tracks.key_frame]
    counted = np.isin(tracks.track, chosen) & (tracks.frame != key_frames[tracks.track])
    sigma_px = tracks.sigma_px[tracks.track]
    cost = np.log1p((errors_px / sigma_px) ** 2)
    return float(cost[counted].mean()), float(np.median(errors_px[counted]))


def _moved(before: Scene, after: Scene, frames: IntArray) -> tuple[FloatArray, FloatArray]:
    """How far the cameras of ``frames`` turned, degrees, and their centres moved, world unit."""
    pairs = [(before.frames[f].camera, after.frames[f].camera) for f in frames]
    turns = np.array([new.R_cam_from_world @ old.R_cam_from_world.T for old, new in pairs])
    shifts = np.array([new.center_world - old.center_world for old, new in pairs])
    return np.rad2deg(Rotation.from_matrix(turns).magnitude()), np.linalg.norm(shifts, axis=1)
