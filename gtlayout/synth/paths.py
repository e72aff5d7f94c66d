"""Where the camera goes in a synthetic room: hand-held orbit, real-estate dolly, a recorded path, pure rotation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Literal

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.re10k import Re10kCamera
from gtlayout.scene import BoolArray, FloatArray
from gtlayout.synth.motion import CameraPath, looking, sway
from gtlayout.synth.room import Room

CameraKind = Literal["orbit", "dolly", "rotation"]

EYE_HEIGHT_M = 1.5
PITCH_DEG = -5.0
LOWEST_M, HEADROOM_M = 0.3, 0.3
"""Cameras stay so far above the floor and below the ceiling."""

STEP_DEG = 1.7
"""Turn per frame of an orbit and of a pure rotation."""
MAX_ORBIT_DEG, MAX_ROTATION_DEG = 100.0, 80.0
SWAY_M, SWAY_DEG = 0.02, 0.6
"""σ of the hand's unsteadiness about the path."""
SWAY_FRAMES = 8
"""The unsteadiness changes its direction about once in this many frames."""
GIMBAL_SHARE = 0.2
"""Share of the unsteadiness that is left with a gimbal."""

ORBIT_RADII_M = np.arange(2.6, 0.5, -0.1)
ORBIT_TURNS_DEG = tuple(sign * turn for turn in range(0, 91, 10) for sign in (-1, 1))
"""How far aside from the near end the middle of an orbit may lie."""
MAX_OFF_RAD = 0.5
"""An orbit never looks past the focus by more."""
ORBIT_SHARES = (1.0, 0.7, 0.45, 0.25, 0.1)
"""Shares of the sweep that are tried."""

DOLLY_M = (0.7, 1.3)
"""Least and greatest length of a made dolly path."""
DOLLY_ASIDE_DEG = 70.0
"""Its greatest angle between motion and view."""
DOLLY_PAN_DEG = (8.0, 25.0)
REPLAY_M = 1.2
"""Length of a recorded path in the room, unless it must be shorter to stay in it: its own scale is unknown."""

PLACES = 400
"""Places tried for a path in a room."""
SHRINK, SHRINKS = 0.8, 12
MIN_FOCUS_M, FAR_FOCUS_M = 0.8, 3.0
"""The camera keeps so far from what it looks at; being further away is better, up to the second."""
RAD_PER_M = 0.2
"""How far off the middle of the view the focus may be to be seen from a metre further away."""
AIM_DEG = 8.0
"""σ of the aim."""
NEAR_END_DEG = 70.0
"""The focus lies at most so far aside of straight ahead from the near end: elsewhere stand sofas and cupboards."""
ROLL_SIGMA_RAD, PITCH_SIGMA_RAD = 0.02, 0.1
"""How upright and how level a recorded camera is held."""


def orbit_path(room: Room, frames: int, rng: np.random.Generator) -> CameraPath:
    """Hand-held arc about the middle of a room, looking in: rightwards from the left, leftwards from the right.

    Through the near half of the room when that is free; else the widest arc about the room's focus that finds place.
    """
    sweep_deg = min(MAX_ORBIT_DEG, STEP_DEG * (frames - 1)) * rng.choice([-1, 1])
    unsteady = sway(frames, 6, SWAY_FRAMES, rng)
    footprint = _footprint(room)
    height_m = np.full(frames, min(EYE_HEIGHT_M, room.height_m - 2 * HEADROOM_M))
    for middle, radii_m, turn_deg, share in _arcs(room, np.deg2rad(abs(sweep_deg))):
        arc_deg = np.linspace(-sweep_deg / 2, sweep_deg / 2, frames) * share + turn_deg
        arc = np.deg2rad(arc_deg)
        places = np.column_stack([middle[0] + radii_m[0] * np.sin(arc), middle[1] - radii_m[1] * np.cos(arc)])
        centers = np.column_stack([places, height_m]) + SWAY_M * unsteady[:, :3]
        angles_deg = np.column_stack([-arc_deg, np.full(frames, PITCH_DEG), np.zeros(frames)])
        path = CameraPath(_rotations(angles_deg + SWAY_DEG * unsteady[:, 3:]), centers)
        if (
            _stays(room.standing, centers)
            and _off_focus_rad(path, room).max() < MAX_OFF_RAD
            and _sees(room, path, footprint)
        ):
            return path
    raise GtlayoutError("this synthetic room has no place for an orbit: take another seed or camera path")


def dolly_path(room: Room, frames: int, rng: np.random.Generator) -> CameraPath:
    """What a real-estate film shows: slowly forwards or sideways for about a metre, with a gentle pan, on a gimbal."""
    length_m = rng.uniform(*DOLLY_M)
    aside = np.deg2rad(rng.uniform(-DOLLY_ASIDE_DEG, DOLLY_ASIDE_DEG))
    pan_deg = rng.uniform(*DOLLY_PAN_DEG) * rng.choice([-1, 1])
    unsteady = GIMBAL_SHARE * sway(frames, 6, SWAY_FRAMES, rng)
    along = np.linspace(-0.5, 0.5, frames)
    centers = length_m * np.column_stack([np.sin(aside) * along, np.cos(aside) * along, np.zeros(frames)])
    angles_deg = np.column_stack([pan_deg * along, np.full(frames, PITCH_DEG), np.zeros(frames)])
    path = CameraPath(_rotations(angles_deg + SWAY_DEG * unsteady[:, 3:]), centers + SWAY_M * unsteady[:, :3])
    return _placed(path, room, rng)


def replay_path(room: Room, recorded: Sequence[Re10kCamera], at_s: FloatArray, rng: np.random.Generator) -> CameraPath:
    """A recorded path at (N,) times since its first camera: its own rotations, its own way up to one similarity.

    Turned so that its cameras are as upright and level as they can be, scaled to ``REPLAY_M`` or so much less that it
    stays in the room, and placed and turned about the vertical to look into the room.
    """
    times_s = np.array([camera.timestamp_us - recorded[0].timestamp_us for camera in recorded]) / 1e6
    if len(times_s) < 2:
        raise GtlayoutError("a recorded path needs at least 2 cameras to be replayed")
    R_cam_from_file = np.stack([camera.R_cam_from_world for camera in recorded])
    centers_file = np.stack([-camera.R_cam_from_world.T @ camera.t_cam_from_world for camera in recorded])
    R_room_from_file = upright(R_cam_from_file)
    length = float(np.linalg.norm(np.diff(centers_file, axis=0), axis=1).sum())
    scale = REPLAY_M / length if length > 0 else 1.0
    path = CameraPath(R_cam_from_file @ R_room_from_file.T, scale * centers_file @ R_room_from_file.T)
    return _placed(path.at(times_s, at_s), room, rng)


def rotation_path(room: Room, frames: int, rng: np.random.Generator) -> CameraPath:
    """A camera on a tripod that only turns: no baseline, so no depth."""
    sweep_deg = min(MAX_ROTATION_DEG, STEP_DEG * (frames - 1)) * rng.choice([-1, 1])
    unsteady = sway(frames, 3, SWAY_FRAMES, rng)
    yaw_deg = np.linspace(-sweep_deg / 2, sweep_deg / 2, frames)
    angles_deg = np.column_stack([yaw_deg, np.full(frames, PITCH_DEG), np.zeros(frames)])
    return _placed(CameraPath(_rotations(angles_deg + SWAY_DEG * unsteady), np.zeros((frames, 3))), room, rng)


def upright(R_cam_from_world: FloatArray) -> FloatArray:
    """(3, 3) rotation into a world whose z is up, from (N, 3, 3) rotations of cameras in a world that has no up.

    Hands keep a camera's x axis level, and its z axis less strictly so: up is the direction nearest to orthogonal to
    both. Without a turn the x axes alone would leave the pitch open.
    """
    x_axes, y_axes, z_axes = np.moveaxis(R_cam_from_world, 1, 0)
    level = x_axes.T @ x_axes / ROLL_SIGMA_RAD**2 + z_axes.T @ z_axes / PITCH_SIGMA_RAD**2
    up = np.linalg.eigh(level)[1][:, 0]
    up *= -np.sign(up @ y_axes.sum(axis=0))
    x_axis = x_axes[0] - up * (up @ x_axes[0])
    x_axis /= np.linalg.norm(x_axis)
    return np.stack([x_axis, np.cross(up, x_axis), up])


def _arcs(room: Room, sweep_rad: float) -> Iterator[tuple[FloatArray, FloatArray, float, float]]:
    """Arcs to try: (2,) middle and (2,) half-axes in m, turn about the middle in degrees, share of the sweep."""
    floor = next(surface for surface in room.surfaces if surface.label == "floor")
    size_m = floor.corners_world[:, :2].max(axis=0)  # of a rectangular floor that starts at the origin
    yield 0.5 * size_m, np.array([0.3, 0.33]) * size_m, 0.0, 1.0
    about_focus = product(ORBIT_RADII_M, ORBIT_TURNS_DEG, ORBIT_SHARES)
    # Widest first; the sort keeps those that begin nearer to the near end before others as wide.
    for radius_m, turn_deg, share in sorted(about_focus, key=lambda arc: -arc[0] * np.sin(sweep_rad * arc[2] / 2)):
        yield room.focus, np.array([radius_m, radius_m]), float(turn_deg), float(share)


def _placed(path: CameraPath, room: Room, rng: np.random.Generator) -> CameraPath:
    """The path (z up, m) moved, turned about z and, if need be, shrunk, so that it stays and looks where it should."""
    views = path.R_cam_from_world[:, 2]
    heading = np.arctan2(views[:, 0].sum(), views[:, 1].sum())
    middle = (path.centers_world.min(axis=0) + path.centers_world.max(axis=0)) / 2
    centers = path.centers_world - middle
    left, near, right, far = room.standing.bounds
    places = rng.uniform((left, near), (right, far), (PLACES, 2))
    places = places[shapely.contains_xy(room.standing, places)]
    yaws = np.arctan2(*(room.focus - places).T)
    places, yaws = (each[np.abs(yaws) < np.deg2rad(NEAR_END_DEG)] for each in (places, yaws))
    yaws = yaws + np.deg2rad(AIM_DEG) * rng.standard_normal(len(yaws))
    footprint = _footprint(room)
    height_m = min(EYE_HEIGHT_M, room.height_m - 2 * HEADROOM_M)
    for scale in SHRINK ** np.arange(SHRINKS):
        if height_m + scale * centers[:, 2].max() > room.height_m - HEADROOM_M:
            continue
        if height_m + scale * centers[:, 2].min() < LOWEST_M:
            continue
        found: list[tuple[float, CameraPath]] = []
        for place, yaw in zip(places, yaws, strict=True):
            cos, sin = np.cos(yaw - heading), np.sin(yaw - heading)
            R_room_from_path = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
            moved = CameraPath(
                path.R_cam_from_world @ R_room_from_path.T,
                scale * centers @ R_room_from_path.T + np.array([*place, height_m]),
            )
            distance_m = np.linalg.norm(room.focus - moved.centers_world[:, :2], axis=1)
            if distance_m.min() < MIN_FOCUS_M or not _stays(room.standing, moved.centers_world):
                continue
            worth = RAD_PER_M * min(float(distance_m.mean()), FAR_FOCUS_M) - _off_focus_rad(moved, room).mean()
            found.append((worth, moved))
        for _, moved in sorted(found, key=lambda each: -each[0]):
            if _sees(room, moved, footprint):
                return moved
    raise GtlayoutError("this synthetic room has no place for the camera path: take another seed or path")


def _rotations(angles_deg: FloatArray) -> FloatArray:
    """(N, 3, 3) from (N, 3) yaw, pitch, roll."""
    return np.stack([looking(*each) for each in np.deg2rad(angles_deg)])


def _stays(standing: Polygon, centers_world: FloatArray) -> bool:
    """Whether all (N, 3) centres are where a camera may be."""
    inside: BoolArray = shapely.contains_xy(standing, centers_world[:, :2])
    return bool(inside.all())


def _off_focus_rad(path: CameraPath, room: Room) -> FloatArray:
    """(N,) horizontal angles between the view and the direction of the room's focus."""
    views = path.R_cam_from_world[:, 2]
    to_focus = room.focus - path.centers_world[:, :2]
    off = np.arctan2(to_focus[:, 0], to_focus[:, 1]) - np.arctan2(views[:, 0], views[:, 1])
    return np.abs((off + np.pi) % (2 * np.pi) - np.pi)


def _sees(room: Room, path: CameraPath, footprint: BaseGeometry) -> bool:
    """Whether no wall stands between the path's ends and the focus."""
    ends = path.centers_world[[0, len(path.centers_world) // 2, -1], :2]
    return all(footprint.covers(LineString([end, room.focus])) for end in ends)


def _footprint(room: Room) -> BaseGeometry:
    """x, y of all floors."""
    floors = [Polygon(surface.corners_world[:, :2]) for surface in room.surfaces if surface.label == "floor"]
    # Floors that abut leave no slit between them.
    return shapely.union_all(floors).buffer(1e-3)
