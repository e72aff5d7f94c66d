"""Stage 1, first part: sample points on visible parts of key frames and follow them through the video (paper 3.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.memory import Memory
from gtlayout.scene import FloatArray, Frame, IntArray, Scene
from gtlayout.threads import in_threads
from gtlayout.tracking.config import TrackingConfig
from gtlayout.tracking.follow import follow
from gtlayout.tracking.image_cache import ImageCache, Images
from gtlayout.tracking.klt import KltTracker, PairTracker
from gtlayout.tracking.raft import RaftTracker
from gtlayout.tracking.sampling import sample_points, sampled_region, texture_sigma_px
from gtlayout.tracking.tracks import Tracks


def track(
    scene: Scene,
    config: TrackingConfig,
    seed: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
    tracker: PairTracker | None = None,
    memory: Memory | None = None,
) -> Tracks:
    """Sample points on every element of every key frame and follow them both ways through the video.

    Each step removes the known rotation before matching, predicts the rest from the depth seen so far, and re-anchors
    the result on the key frame's own patch, so that error does not add up along a track. A track ends at the first
    failure.

    ``memory`` keeps the tracks of each key frame, for one ``tracker``.

    Raises:
        GtlayoutError: no element is annotated, an annotated image cannot be read, or RAFT cannot be loaded.
    """
    scene.require_elements()
    tracker, memory = tracker or _tracker(config), memory or Memory()
    images = ImageCache(scene, config.max_frames)

    def followed(k: int) -> _Followed:
        key_frame = scene.key_frames[k]
        regions = tuple(sampled_region(element, config) for element in key_frame.elements)
        reach = range(max(0, key_frame.frame - config.max_frames), key_frame.frame + config.max_frames + 1)
        seen = tuple((f, frame.name, frame.image_path, frame.camera) for f, frame in _some(scene.frames, reach))
        with images.near(key_frame.frame) as near:
            return memory.of(
                "tracks of a key frame",
                (key_frame.frame, regions, seen, config, seed),
                partial(_of_key_frame, scene, near, k, config, seed, tracker),
            )

    numbers = range(len(scene.key_frames))
    progress(0, len(numbers))
    parts = []
    # RAFT fills its device alone, and a video gives its frames in one order only.
    for part in in_threads(followed, numbers, alone=not isinstance(tracker, KltTracker) or _of_video(scene)):
        parts.append(part)
        progress(len(parts), len(numbers))
    first_of = np.cumsum([0, *(len(part.element) for part in parts)])
    return Tracks(
        key_frame=np.repeat(np.arange(len(parts)), [len(part.element) for part in parts]),
        element=np.concatenate([part.element for part in parts]),
        track=np.concatenate([part.track + first for part, first in zip(parts, first_of[:-1], strict=True)]),
        frame=np.concatenate([part.frame for part in parts]),
        points_px=np.concatenate([part.points_px for part in parts]),
        sigma_px=np.concatenate([part.sigma_px for part in parts]),
        tried=tuple(part.tried for part in parts),
        unreadable=tuple(scene.frames[f].name for f in sorted({f for part in parts for f in part.unreadable})),
    )


@dataclass(frozen=True)
class _Followed:
    """The n points of one key frame that could be followed, and their m positions, sorted by (track, frame)."""

    element: IntArray
    """(n,)."""
    sigma_px: FloatArray
    """(n,)."""
    track: IntArray
    """(m,) which of the n."""
    frame: IntArray
    points_px: FloatArray
    tried: IntArray
    """(elements,)."""
    unreadable: tuple[int, ...]
    """Frames that could not be read."""


def _of_video(scene: Scene) -> bool:
    return any(frame.video is not None for frame in scene.frames)


def _some(frames: Sequence[Frame], numbers: range) -> list[tuple[int, Frame]]:
    return [(f, frames[f]) for f in numbers if f < len(frames)]


def _of_key_frame(
    scene: Scene,
    images: Images,
    k: int,
    config: TrackingConfig,
    seed: int,
    tracker: PairTracker,
) -> _Followed:
    """Points sampled on the elements of key frame ``k``, followed both ways."""
    key, elements = scene.key_frames[k].frame, scene.key_frames[k].elements
    image = images(key)
    if image is None:
        raise GtlayoutError(f"{images.errors[key]}; it is annotated: mend it or remove its annotation")
    per_element = [sample_points(image, element, config, seed) for element in elements]
    start = np.concatenate(per_element) if per_element else np.empty((0, 2))
    followed = [(np.arange(len(start)), np.full(len(start), key), start)]
    for direction in (-1, 1):
        followed += follow(scene, images, k, start, direction, config, tracker)
    index, frame, position = (np.concatenate(part) for part in zip(*followed, strict=True))
    kept = np.bincount(index, minlength=len(start)) >= config.min_observations
    number = np.cumsum(kept) - 1
    use = kept[index]
    order = np.lexsort((frame[use], index[use]))
    return _Followed(
        element=np.repeat(np.arange(len(per_element)), [len(p) for p in per_element])[kept],
        sigma_px=texture_sigma_px(image, start[kept], config),
        track=number[index[use]][order],
        frame=frame[use][order],
        points_px=position[use][order],
        tried=np.array([len(p) for p in per_element], dtype=np.int64),
        unreadable=tuple(sorted(images.errors)),
    )


def _tracker(config: TrackingConfig) -> PairTracker:
    """RAFT where its weights are given, else Lucas-Kanade."""
    if config.raft_weights is not None:
        return RaftTracker.load(Path(config.raft_weights), config.max_forward_backward_px)
    return KltTracker(config.window_px, config.levels, config.max_forward_backward_px)
