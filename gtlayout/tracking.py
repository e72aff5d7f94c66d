"""Stage 1: sample points on the visible parts of each key frame and track them through the video (paper 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

from gtlayout.scene import FloatArray, IntArray


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
    tried: tuple[IntArray, ...]
    """Per key frame, (elements,) how many points were sampled on each element; few that survive mean a poor surface."""

    def __len__(self) -> int:
        return len(self.key_frame)
