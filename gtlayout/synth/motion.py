"""Camera motion over time: poses, interpolation between them, the unsteadiness of a hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class CameraPath:
    """Poses, one after another."""

    R_cam_from_world: FloatArray
    """(N, 3, 3) rotations."""
    centers_world: FloatArray
    """(N, 3) camera centres, world unit."""

    def at(self, times: FloatArray, wanted: FloatArray) -> CameraPath:
        """The poses at the (M,) ``wanted`` times, when those of this path are at (N,) ``times``, any unit.

        Splines with continuous velocity and acceleration; at ``times`` themselves they pass through the poses. N must
        be at least 2.
        """
        rotations = RotationSpline(times, Rotation.from_matrix(self.R_cam_from_world))
        return CameraPath(rotations(wanted).as_matrix(), CubicSpline(times, self.centers_world)(wanted))


def looking(yaw_rad: float, pitch_rad: float, roll_rad: float) -> FloatArray:
    """(3, 3) ``R_cam_from_world``: yaw from the world's y towards x, pitch upwards, roll clockwise; z is up."""
    forward = np.array([np.sin(yaw_rad) * np.cos(pitch_rad), np.cos(yaw_rad) * np.cos(pitch_rad), np.sin(pitch_rad)])
    right = np.array([np.cos(yaw_rad), -np.sin(yaw_rad), 0.0])
    down = np.cross(forward, right)
    cos, sin = np.cos(roll_rad), np.sin(roll_rad)
    return np.stack([cos * right + sin * down, cos * down - sin * right, forward])


def sway(frames: int, columns: int, knot_frames: int, rng: np.random.Generator) -> FloatArray:
    """(frames, columns) smooth noise that turns about once in ``knot_frames``: σ is 1 at the knots, .85 between."""
    knots = np.arange(0, frames + 2 * knot_frames, knot_frames)
    return np.asarray(CubicSpline(knots, rng.standard_normal((len(knots), columns)))(np.arange(frames)), np.float64)


def drift(frames: int, columns: int, knot_frames: int, rng: np.random.Generator) -> FloatArray:
    """(frames, columns) smooth noise like ``sway``, with σ = 1 at every frame."""
    knots = np.arange(-knot_frames, frames + 2 * knot_frames, knot_frames)
    weights = CubicSpline(knots, np.eye(len(knots)))(np.arange(frames))
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return np.asarray(weights @ rng.standard_normal((len(knots), columns)), np.float64)
