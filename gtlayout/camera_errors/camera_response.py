"""What the depths of tracks change by when cameras are a little wrong: plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class CameraResponse:
    """For each of Q independent ways in which the cameras may be wrong, by one σ: what N tracks and K key frames do.

    What all surfaces share, no residual shows: only this tells how far they may be off together.
    """

    rho_share: FloatArray
    """(N, Q) change of each track's inverse depth, as a share of it."""
    center: FloatArray
    """(K, Q, 3) shifts of the key frames' camera centres, world unit."""
    turn: FloatArray
    """(K, Q, 3) rotation vectors by which the rays of key frames turn, world axes, radians."""

    @classmethod
    def none(cls, tracks: int, key_frames: int) -> Self:
        """Of cameras that are exact."""
        return cls(np.empty((tracks, 0)), np.empty((key_frames, 0, 3)), np.empty((key_frames, 0, 3)))
