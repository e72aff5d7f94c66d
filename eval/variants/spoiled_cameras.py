"""Cameras as they come wrong: another lens, drift, delay, jitter. Pure functions of a scene's cameras, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gtlayout.scene import Camera, FloatArray, Scene

YAW_DEG, ROLL_DEG = 3.0, 2.0
SCALE_DRIFT = 0.3
JITTER_DEG, JITTER_M = 0.2, 0.01
"""σ along each axis, of each frame by itself."""
JITTER_SHARE = 0.002
"""Of the length of the camera's path, in place of the centimetre where the scene has no unit: that of 5 m."""

Cameras = tuple[Camera, ...]


def spoiled_cameras(scene: Scene) -> dict[str, Callable[[], Cameras]]:
    """Name of what is wrong → the cameras of all frames."""
    cameras = tuple(frame.camera for frame in scene.frames)
    return {
        "focal length + 5 %": lambda: other_focal(cameras, 1.05),
        "focal length − 5 %": lambda: other_focal(cameras, 0.95),
        f"yaw drifting by {YAW_DEG:g}°": lambda: yaw_drift(cameras, YAW_DEG),
        f"roll {ROLL_DEG:g}°": lambda: rolled(cameras, ROLL_DEG),
        f"scale drifting by {SCALE_DRIFT:g}": lambda: scale_drift(cameras, SCALE_DRIFT),
        "poses 1 frame late": lambda: late(cameras, 1),
        "poses 2 frames late": lambda: late(cameras, 2),
        f"pose jitter {JITTER_DEG:g}°, 1 cm": lambda: jittered(cameras, JITTER_DEG, _centimetre(scene)),
    }


def other_focal(cameras: Sequence[Camera], factor: float) -> Cameras:
    """Both focal lengths times a factor."""
    longer = np.array([[factor, factor, 1.0], [1.0, factor, 1.0], [1.0, 1.0, 1.0]])
    return tuple(replace(camera, K=camera.K * longer) for camera in cameras)


def rolled(cameras: Sequence[Camera], degrees: float) -> Cameras:
    """All cameras turned about their optical axes."""
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return tuple(
        replace(
            camera, R_cam_from_world=turn @ camera.R_cam_from_world, t_cam_from_world=turn @ camera.t_cam_from_world
        )
        for camera in cameras
    )


def yaw_drift(cameras: Sequence[Camera], degrees: float) -> Cameras:
    """Odometry whose heading drifts evenly: each step is turned by as much as has come together, and so is the view.

    Vertical is what the cameras have for it on average.
    """
    up = np.mean([camera.R_cam_from_world[1] for camera in cameras], axis=0)
    up /= np.linalg.norm(up)
    turns = [
        Rotation.from_rotvec(angle * up).as_matrix() for angle in np.deg2rad(np.linspace(0, degrees, len(cameras)))
    ]
    centers = _walked(cameras, [turn @ step for turn, step in zip(turns, _steps(cameras), strict=False)])
    return tuple(
        camera.placed(camera.R_cam_from_world @ turn.T, center)
        for camera, turn, center in zip(cameras, turns, centers, strict=True)
    )


def scale_drift(cameras: Sequence[Camera], share: float) -> Cameras:
    """Steps too short at the start and too long at the end, by half of ``share`` each: right on average."""
    factors = np.linspace(1 - share / 2, 1 + share / 2, len(cameras) - 1)
    centers = _walked(cameras, [factor * step for factor, step in zip(factors, _steps(cameras), strict=True)])
    pairs = zip(cameras, centers, strict=True)
    return tuple(camera.placed(camera.R_cam_from_world, center) for camera, center in pairs)


def late(cameras: Sequence[Camera], frames: int) -> Cameras:
    """Each frame with the pose of so many frames before; the first ones with the first pose."""
    earlier = [cameras[max(i - frames, 0)] for i in range(len(cameras))]
    return tuple(
        replace(camera, R_cam_from_world=of.R_cam_from_world, t_cam_from_world=of.t_cam_from_world)
        for camera, of in zip(cameras, earlier, strict=True)
    )


def jittered(cameras: Sequence[Camera], sigma_deg: float, sigma_position: float, seed: int = 0) -> Cameras:
    """Poses off by Gaussian errors, each frame by itself; the position in the world's unit."""
    rng = np.random.default_rng(seed)
    spoiled = []
    for camera in cameras:
        turn = Rotation.from_rotvec(np.deg2rad(rng.normal(0, sigma_deg, 3))).as_matrix()
        center = camera.center_world + rng.normal(0, sigma_position, 3)
        spoiled.append(camera.placed(turn @ camera.R_cam_from_world, center))
    return tuple(spoiled)


def path_length(cameras: Sequence[Camera]) -> float:
    """Of the camera's way, world unit."""
    return float(np.linalg.norm(_steps(cameras), axis=1).sum())


def _centimetre(scene: Scene) -> float:
    return JITTER_M if scene.metric else JITTER_SHARE * path_length([frame.camera for frame in scene.frames])


def _steps(cameras: Sequence[Camera]) -> FloatArray:
    """(N - 1, 3) from each camera centre to the next."""
    return np.diff([camera.center_world for camera in cameras], axis=0)


def _walked(cameras: Sequence[Camera], steps: Sequence[FloatArray]) -> FloatArray:
    """(N, 3) camera centres, from the first one on by steps."""
    return cameras[0].center_world + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
