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


def observe(
    scene: Scene,
    tracks: Tracks,
    chosen: IntArray,
    max_frames: int,
    max_observations: int,
    keep_frames: bool = False,
) -> Observations:
    """Positions of the ``chosen`` tracks in at most ``max_frames`` frames spread over the video, and in key frames.

    Of each track at most ``max_observations``, spread over it. Tracks without any are left out; so are frames, but for
    ``keep_frames``.
    """
    count = len(scene.frames)
    key_frames = np.array([key_frame.frame for key_frame in scene.key_frames])
    spread = np.linspace(0, count - 1, min(max_frames, count)).round().astype(np.int64)
    frames = np.union1d(spread, key_frames)
    at_key = key_frames[tracks.key_frame]
    is_key = tracks.frame == at_key[tracks.track]
    key_px = np.empty((len(tracks), 2))
    key_px[tracks.track[is_key]] = tracks.points_px[is_key]
    candidates = np.isin(tracks.track, chosen) & ~is_key & np.isin(tracks.frame, frames)
    index = np.flatnonzero(candidates)
    index = index[evenly_spread(tracks.track[index], max_observations)]
    seen, track = np.unique(tracks.track[index], return_inverse=True)
    used = frames if keep_frames else np.union1d(tracks.frame[index], at_key[seen])
    return Observations(
        tracks=seen,
        track=track,
        frames=used,
        frame=np.searchsorted(used, tracks.frame[index]),
        key_frame=np.searchsorted(used, at_key[seen][track]),
        key_px=key_px[seen][track],
        points_px=tracks.points_px[index],
        sigma_px=tracks.sigma_px[seen][track],
    )
