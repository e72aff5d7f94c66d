"""Point tracks: the result of stage 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.scene import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Tracks:
    """N point tracks with M observations in all; flat arrays, observations sorted by (track, frame)."""

    key_frame: IntArray
    """(N,) the key frame each point was sampled in."""
    element: IntArray
    """(N,) the element (index in that key frame) it was sampled on."""
    track: IntArray
    """(M,) which track an observation belongs to."""
    frame: IntArray
    """(M,) index into ``Scene.frames``."""
    points_px: FloatArray
    """(M, 2) position."""
    sigma_px: FloatArray
    """(N,) noise to expect of a point's positions: weak texture is matched less well."""
    tried: tuple[IntArray, ...]
    """Per key frame, (elements,) how many points were sampled on each element. If few survive, it tracks badly."""
    unreadable: tuple[str, ...] = ()
    """Names of the images that could not be read and were stepped over."""

    def __len__(self) -> int:
        return len(self.key_frame)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Problems during tracking, one line each."""
        if not self.unreadable:
            return ()
        return (f"{len(self.unreadable)} unreadable image(s) skipped: {', '.join(self.unreadable)}",)


def spread_observations(tracks: Tracks, most: int) -> BoolArray:
    """(M,) up to ``most`` observations of each track, evenly spread over it, its ends among them."""
    return evenly_spread(tracks.track, most)


def evenly_spread(track: IntArray, most: int) -> BoolArray:
    """(M,) up to ``most`` of each run of equal indices in ascending ``track``, evenly spread over it, its ends too."""
    _, first, run, lengths = np.unique(track, return_index=True, return_inverse=True, return_counts=True)
    position = np.arange(len(track)) - first[run]
    slots = (np.minimum(lengths, most) - 1)[run]
    last = np.maximum(lengths - 1, 1)[run]
    chosen: BoolArray = (position * slots) // last > ((position - 1) * slots) // last
    return chosen | (position == 0)
