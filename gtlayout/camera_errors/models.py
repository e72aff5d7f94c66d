"""Errors that all cameras of a video share, each a function of its whole path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gtlayout.camera_errors.path import CameraPath
from gtlayout.scene import FloatArray
from gtlayout.tracking.config import CameraErrorConfig, ErrorScale


def longer_focal(path: CameraPath, log_factor: FloatArray) -> CameraPath:
    """Focal lengths times exp of a (1,) logarithm."""
    K = path.K.copy()
    K[:, [0, 1], [0, 1]] *= np.exp(log_factor[0])
    return replace(path, K=K)


def moved_principal_point(path: CameraPath, shift_widths: FloatArray) -> CameraPath:
    """Principal points moved by (2,) widths of their images."""
    K = path.K.copy()
    K[:, :2, 2] += path.widths_px[:, None] * shift_widths
    return replace(path, K=K)


def rolled(path: CameraPath, angle: FloatArray) -> CameraPath:
    """Cameras turned about their optical axes by a (1,) angle, radians."""
    turn = Rotation.from_rotvec([0.0, 0.0, angle[0]]).as_matrix()
    return replace(path, R_cam_from_world=turn @ path.R_cam_from_world)


def turning(path: CameraPath, turn: FloatArray) -> CameraPath:
    """The heading turns evenly by a (3,) rotation vector of the world from the first frame to the last, radians.

    Each step is turned by as much as has come together before it, and so is the view: the drift of an odometry.
    """
    turns = Rotation.from_rotvec(np.linspace(0, 1, len(path))[:, None] * turn).as_matrix()
    steps = np.einsum("fij,fj->fi", turns[:-1], np.diff(path.centers_world, axis=0))
    R_cam_from_world = path.R_cam_from_world @ turns.transpose(0, 2, 1)
    return replace(path, R_cam_from_world=R_cam_from_world, centers_world=_walked(path, steps))


def stretching(path: CameraPath, log_factor: FloatArray) -> CameraPath:
    """Steps at the end are longer by exp of a (1,) logarithm than those at the start; right on average."""
    steps = np.diff(path.centers_world, axis=0)
    factors = np.exp(log_factor[0] * np.linspace(-0.5, 0.5, len(steps)))
    return replace(path, centers_world=_walked(path, factors[:, None] * steps))


def later(path: CameraPath, frames: FloatArray) -> CameraPath:
    """Poses of (1,) so many frames later, evenly between frames; beyond the ends the last motion goes on."""
    last = len(path) - 1
    at = np.arange(len(path)) + frames[0]
    before = np.clip(np.floor(at).astype(int), 0, max(last - 1, 0))
    after = np.minimum(before + 1, last)
    share = (at - before)[:, None]
    R, centers = path.R_cam_from_world, path.centers_world
    turns = Rotation.from_matrix(R[after] @ R[before].transpose(0, 2, 1)).as_rotvec()
    return replace(
        path,
        R_cam_from_world=Rotation.from_rotvec(share * turns).as_matrix() @ R[before],
        centers_world=centers[before] + share * (centers[after] - centers[before]),
    )


def _walked(path: CameraPath, steps: FloatArray) -> FloatArray:
    """(F, 3) centres from the first one on by (F - 1, 3) steps."""
    return path.centers_world[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


@dataclass(frozen=True)
class CameraError:
    """One way in which all cameras may be wrong together."""

    name: str
    size: int
    """How many values it has."""
    correct: Callable[[CameraPath, FloatArray], CameraPath]
    """Corrects a path by the error's (size,) values."""
    scale: ErrorScale
    """In the unit of the values."""


def camera_errors(config: CameraErrorConfig) -> tuple[CameraError, ...]:
    """All that are looked for. Angles are in radians, the principal point in widths of the image."""
    return (
        CameraError("focal length", 1, longer_focal, config.focal_log),
        CameraError("principal point", 2, moved_principal_point, config.principal_point_widths),
        CameraError("roll", 1, rolled, _radians(config.roll_deg)),
        CameraError("heading", 3, turning, _radians(config.heading_deg)),
        CameraError("scale", 1, stretching, config.scale_log),
        CameraError("delay", 1, later, config.delay_frames),
    )


def corrected(path: CameraPath, errors: Sequence[CameraError], values: FloatArray) -> CameraPath:
    """The path corrected by the (P,) values of all errors, one after another."""
    for error, own in zip(errors, split(errors, values), strict=True):
        path = error.correct(path, own) if np.any(own) else path
    return path


def split(errors: Sequence[CameraError], values: FloatArray) -> list[FloatArray]:
    """(P,) values of all errors, error by error."""
    return np.split(values, np.cumsum([error.size for error in errors])[:-1])


def _radians(degrees: ErrorScale) -> ErrorScale:
    prior, floor, matters = np.deg2rad([degrees.prior, degrees.floor, degrees.matters]).tolist()
    return ErrorScale(prior, floor, matters)
