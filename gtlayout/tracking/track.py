"""Stage 1, first part: sample points on visible parts of key frames and follow them through the video (paper 3.2)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from gtlayout.errors import GtlayoutError
from gtlayout.scene import Scene
from gtlayout.tracking.config import TrackingConfig
from gtlayout.tracking.follow import follow
from gtlayout.tracking.image_cache import ImageCache
from gtlayout.tracking.klt import KltTracker, PairTracker
from gtlayout.tracking.raft import RaftTracker
from gtlayout.tracking.sampling import sample_points, texture_sigma_px
from gtlayout.tracking.tracks import Tracks


def track(
    scene: Scene,
    config: TrackingConfig,
    seed: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
    tracker: PairTracker | None = None,
) -> Tracks:
    """Sample points on every element of every key frame and follow them both ways through the video.

    Each step removes the known rotation before matching, predicts the rest from the depth seen so far, and re-anchors
    the result on the key frame's own patch, so that error does not add up along a track. A track ends at the first
    failure.

    Raises:
        GtlayoutError: no element is annotated, an annotated image cannot be read, or RAFT cannot be loaded.
    """
    scene.require_elements()
    tracker = tracker or _tracker(config)
    images = ImageCache(scene, config.max_frames)
    sampler = qmc.Sobol(d=2, seed=seed)
    key_frames, elements, sigmas, tried = [], [], [], []
    tracks, frames, points = [], [], []
    count = 0
    for k, key_frame in enumerate(scene.key_frames):
        progress(k, len(scene.key_frames))
        images.move_to(key_frame.frame)
        image = images(key_frame.frame)
        if image is None:
            raise GtlayoutError(f"{images.errors[key_frame.frame]}; it is annotated: mend it or remove its annotation")
        per_element = [sample_points(image, element, config, sampler) for element in key_frame.elements]
        tried.append(np.array([len(p) for p in per_element], dtype=np.int64))
        start = np.concatenate(per_element) if per_element else np.empty((0, 2))
        followed = [(np.arange(len(start)), np.full(len(start), key_frame.frame), start)]
        for direction in (-1, 1):
            followed += follow(scene, images, k, start, direction, config, tracker)
        index, frame, position = (np.concatenate(part) for part in zip(*followed, strict=True))
        kept = np.bincount(index, minlength=len(start)) >= config.min_observations
        renumber = np.cumsum(kept) - 1 + count
        count += int(kept.sum())
        use = kept[index]
        tracks.append(renumber[index[use]])
        frames.append(frame[use])
        points.append(position[use])
        key_frames.append(np.full(int(kept.sum()), k))
        sigmas.append(texture_sigma_px(image, start[kept], config))
        elements.append(np.repeat(np.arange(len(per_element)), [len(p) for p in per_element])[kept])
    progress(len(scene.key_frames), len(scene.key_frames))
    track_index, frame_index = np.concatenate(tracks), np.concatenate(frames)
    order = np.lexsort((frame_index, track_index))
    return Tracks(
        key_frame=np.concatenate(key_frames),
        element=np.concatenate(elements),
        track=track_index[order],
        frame=frame_index[order],
        points_px=np.concatenate(points)[order],
        sigma_px=np.concatenate(sigmas),
        tried=tuple(tried),
        unreadable=tuple(scene.frames[frame].name for frame in sorted(images.errors)),
    )


def _tracker(config: TrackingConfig) -> PairTracker:
    """RAFT where its weights are given, else Lucas-Kanade."""
    if config.raft_weights is not None:
        return RaftTracker.load(Path(config.raft_weights), config.max_forward_backward_px)
    return KltTracker(config.window_px, config.levels, config.max_forward_backward_px)
