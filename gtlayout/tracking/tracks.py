"""Point tracks: the result of stage 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
    """Per key frame, (elements,) points or features tried on each element. If few survive, it tracks badly."""
    unreadable: tuple[str, ...] = ()
    """Names of the images that could not be read and were stepped over."""

    def __len__(self) -> int:
        return len(self.key_frame)

    def only(self, kept: BoolArray) -> Tracks:
        """The tracks for which (N,) ``kept`` is true; ``tried`` stays."""
        number = np.cumsum(kept) - 1
        use = kept[self.track]
        return replace(
            self,
            key_frame=self.key_frame[kept],
            element=self.element[kept],
            track=number[self.track[use]],
            frame=self.frame[use],
            points_px=self.points_px[use],
            sigma_px=self.sigma_px[kept],
        )

    def per_element(self) -> tuple[IntArray, ...]:
        """Per key frame, (elements,) how many tracks were sampled on each element."""
        return tuple(
            np.bincount(self.element[self.key_frame == k], minlength=len(tried)) for k, tried in enumerate(self.tried)
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Problems during tracking, one line each."""
        if not self.unreadable:
            return ()
        return (f"{len(self.unreadable)} unreadable image(s) skipped: {', '.join(self.unreadable)}",)


def joined(parts: Sequence[Tracks], tried: tuple[IntArray, ...]) -> Tracks:
    """All tracks of ``parts``, sorted by key frame, and ``tried`` for all of them together."""
    key_frame = np.concatenate([part.key_frame for part in parts])
    order = np.argsort(key_frame, kind="stable")
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    first = np.cumsum([0, *(len(part) for part in parts)])
    track = number[np.concatenate([part.track + before for part, before in zip(parts, first[:-1], strict=True)])]
    frame = np.concatenate([part.frame for part in parts])
    sorted_by = np.lexsort((frame, track))
    return Tracks(
        key_frame=key_frame[order],
        element=np.concatenate([part.element for part in parts])[order],
        track=track[sorted_by],
        frame=frame[sorted_by],
        points_px=np.concatenate([part.points_px for part in parts])[sorted_by],
        sigma_px=np.concatenate([part.sigma_px for part in parts])[order],
        tried=tried,
        unreadable=tuple(sorted({name for part in parts for name in part.unreadable})),
    )


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
