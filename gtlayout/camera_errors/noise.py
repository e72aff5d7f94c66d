"""What given poses are off by without any system: noise, smooth along the video and not, whose size is learned."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from gtlayout.camera_errors.path import CameraPath
from gtlayout.camera_errors.reprojection import DIMENSIONS
from gtlayout.scene import FloatArray, IntArray

_KINDS = 2
"""Rotation vectors and positions."""
_REACH = 1.5
"""Power of a step's factors. From 2 on it would not settle where the tracks show the noise well."""


@dataclass(frozen=True)
class PoseNoise:
    """Gaussian noise of F poses along each of six axes.

    The smooth part has a Matérn correlation of order 3/2, the other part is independent from frame to frame. Both have
    the modes of the smooth part's correlation matrix.
    """

    modes: FloatArray
    """(F, F) one in each column."""
    smoothness: FloatArray
    """(F,) the correlation matrix's eigenvalues."""
    smooth: FloatArray
    """(2,) variance of rotations, radians², and of positions, world unit²."""
    white: FloatArray
    """(2,) the same of the independent part."""

    @classmethod
    def between(cls, frames: IntArray, correlated_frames: float, smooth: FloatArray, white: FloatArray) -> Self:
        """The noise at (F,) frame numbers, with (2,) variances of each part."""
        apart = np.sqrt(3) / correlated_frames * np.abs(frames[:, None] - frames)
        smoothness, modes = np.linalg.eigh((1 + apart) * np.exp(-apart))
        return cls(modes, smoothness, smooth, white)

    def times(self, factor: float) -> PoseNoise:
        """Noise with σ larger by a factor."""
        return replace(self, smooth=factor**2 * self.smooth, white=factor**2 * self.white)

    def size_in(self, usual: PoseNoise) -> float:
        """How many times as large as ``usual`` noise it is: the root of the mean square of its four σ, in those."""
        ratios = np.concatenate([self.smooth / usual.smooth, self.white / usual.white])
        return float(np.sqrt(ratios.mean()))

    def information(self) -> FloatArray:
        """(6 F, 6 F) inverse covariance."""
        of_kind = np.einsum("fm,km,gm->kfg", self.modes, 1 / self._variances, self.modes)
        frames = len(self.modes)
        information = np.zeros((frames, 6, frames, 6))
        for axis in range(6):
            information[:, axis, :, axis] = of_kind[axis // 3]
        return information.reshape(6 * frames, 6 * frames)

    def learned(self, noise: FloatArray, covariance: FloatArray, least: PoseNoise) -> PoseNoise:
        """As large as the (6 F,) ``noise`` with its (6 F, 6 F) covariance shows; at least like ``least``.

        A step of expectation maximisation, taken further: where the tracks show little of the noise, its own steps are
        too short to arrive (Salakhutdinov & Roweis 2003).
        """
        frames = len(self.modes)
        in_modes = self.modes.T @ noise.reshape(frames, 6)
        blocks = np.einsum("fdgd->dfg", covariance.reshape(frames, 6, frames, 6))
        spread = np.einsum("fm,dfm->md", self.modes, blocks @ self.modes)
        second = (in_modes**2 + spread).T.reshape(_KINDS, 3, frames).mean(axis=1)
        per_mode = second / self._variances**2
        smoother = per_mode @ self.smoothness / np.sum(self.smoothness / self._variances, axis=1)
        whiter = per_mode.sum(axis=1) / np.sum(1 / self._variances, axis=1)
        smooth, white = self.smooth * smoother**_REACH, self.white * whiter**_REACH
        return replace(self, smooth=np.maximum(smooth, least.smooth), white=np.maximum(white, least.white))

    @property
    def _variances(self) -> FloatArray:
        """(2, F) of rotations and positions in each mode."""
        return self.smooth[:, None] * self.smoothness + self.white[:, None]


def noise_directions(frames: int) -> FloatArray:
    """(9 F, 6 F) changes of the cameras by the noise of F poses."""
    return np.asarray(np.kron(np.eye(frames), np.eye(DIMENSIONS)[:, :6]), np.float64)


def noisy(path: CameraPath, noise: FloatArray) -> CameraPath:
    """The path with (6 F,) noise: rotation vectors in the camera, and shifts of the centre."""
    turn, shift = noise.reshape(-1, 2, 3).transpose(1, 0, 2)
    return replace(
        path,
        R_cam_from_world=Rotation.from_rotvec(turn).as_matrix() @ path.R_cam_from_world,
        centers_world=path.centers_world + shift,
    )
