"""The positions of tracks that cameras are judged by: some tracks, in some frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.scene import FloatArray, IntArray, Scene
from gtlayout.tracking.tracks import Tracks, evenly_spread


@dataclass(frozen=True)
class Observations:
    """M positions of N tracks outside the key frames they were sampled in, sorted by track, in F frames of a video."""

    tracks: IntArray
    """(N,) index into ``Tracks``."""
    track: IntArray
    """(M,) index into ``tracks``."""
    frames: IntArray
    """(F,) sorted indices into ``Scene.frames``: of all positions, and of the key frames."""
    frame: IntArray
    """(M,) index into ``frames``."""
    key_frame: IntArray
    """(M,) index into ``frames`` of the one in which the track was sampled."""
    key_px: FloatArray
    """(M, 2) where it was sampled: exact, because the positions are matches of its patch."""
    points_px: FloatArray
    """(M, 2) the positions."""
    sigma_px: FloatArray
    """(M,) their noise."""

    @property
    def first(self) -> IntArray:
        """(N,) where each track's positions begin."""
        return np.searchsorted(self.track, np.arange(len(self.tracks)))


def frames_seen(scene: Scene, tracks: Tracks, most: int) -> IntArray:
    """At most ``most`` of the frames in which ``tracks`` were seen, spread over them, and all key frames, sorted."""
    seen = np.unique(tracks.frame)
    spread = seen[np.linspace(0, len(seen) - 1, min(most, len(seen))).round().astype(np.int64)]
    return np.union1d(spread, [key_frame.frame for key_frame in scene.key_frames]).astype(np.int64)


def observe(scene: Scene, tracks: Tracks, chosen: IntArray, frames: IntArray, max_observations: int) -> Observations:
    """Positions of the ``chosen`` tracks in (F,) sorted ``frames``, all key frames among them.

    Of each track at most ``max_observations``, spread over it. Tracks without any are left out.
    """
    at_key = np.array([key_frame.frame for key_frame in scene.key_frames])[tracks.key_frame]
    is_key = tracks.frame == at_key[tracks.track]
    key_px = np.empty((len(tracks), 2))
    key_px[tracks.track[is_key]] = tracks.points_px[is_key]
    candidates = np.isin(tracks.track, chosen) & ~is_key & np.isin(tracks.frame, frames)
    index = np.flatnonzero(candidates)
    index = index[evenly_spread(tracks.track[index], max_observations)]
    seen, track = np.unique(tracks.track[index], return_inverse=True)
    return Observations(
        tracks=seen,
        track=track,
        frames=frames,
        frame=np.searchsorted(frames, tracks.frame[index]),
        key_frame=np.searchsorted(frames, at_key[seen][track]),
        key_px=key_px[seen][track],
        points_px=tracks.points_px[index],
        sigma_px=tracks.sigma_px[seen][track],
    )
