"""Stage 1, beside the tracks: features of whole images matched by their looks alone, by which cameras are judged.

What is found along epipolar lines agrees with the cameras that the lines come from, be they right or wrong. Here two
images are matched without their cameras, furniture and all: only what their own matches agree on counts.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt

from gtlayout.memory import Memory
from gtlayout.scene import BoolArray, FloatArray, Frame, IntArray, Scene
from gtlayout.threads import in_threads
from gtlayout.tracking.config import ImageMatchConfig
from gtlayout.tracking.features import Features, VideoFeatures
from gtlayout.tracking.tracks import Tracks, joined

_STEPS = 255
"""Descriptors of unit length are rounded to so many steps: their products are then whole numbers below 2²⁴, which
single precision adds without rounding, in any order, on every processor."""


@dataclass(frozen=True)
class CameraEvidence:
    """What is known of the cameras besides their poses."""

    judges: Tracks
    """Do not depend on the cameras, and have hardly any error of their own in common."""
    every: Tracks
    """In all frames in which anything was seen."""


def camera_evidence(
    scene: Scene,
    found: VideoFeatures,
    followed: Tracks,
    sigma_px: float,
    config: ImageMatchConfig,
    memory: Memory | None = None,
) -> CameraEvidence:
    """The tracks that cameras are judged by, and those that they may be refined with.

    The first are matched features, if these are enough, else all. The second are all: features and ``followed`` points.
    ``memory`` keeps the matches of each two images, for one extractor of features.
    """
    matched = match_images(scene, found, sigma_px, config, memory)
    every = joined((matched, followed), ())
    if len(matched) >= config.enough_tracks:
        return CameraEvidence(matched, every)
    doubted = replace(followed, sigma_px=config.followed_factor * followed.sigma_px)
    return CameraEvidence(joined((matched, doubted), ()), every)


def match_images(
    scene: Scene, found: VideoFeatures, sigma_px: float, config: ImageMatchConfig, memory: Memory | None = None
) -> Tracks:
    """Tracks of features of the key frames, anywhere in the image, on no element (``Tracks.element`` is -1).

    ``sigma_px`` is the noise of their positions besides that of the features themselves.
    """
    memory = memory or Memory()
    images = {
        f: _Image.of(features.only(_spread(features, _size(scene, f), config.max_features)))
        for f, features in found.of_frame.items()
    }
    keys = [key_frame.frame for key_frame in scene.key_frames if key_frame.frame in images]
    wanted = sorted({(min(key, f), max(key, f)) for key in keys for f in found.nearest(key, config.max_frames)})

    def matched(pair: tuple[int, int]) -> tuple[IntArray, IntArray]:
        first, second = (images[f] for f in pair)
        stamps = [_stamp(scene.frames[f], images[f].features) for f in pair]
        return memory.of("matches", (stamps, config), partial(_matched, first, second, config))

    pairs = dict(zip(wanted, in_threads(matched, wanted), strict=True))
    key_frame, observed, sigma = [], [], []
    for k, key in enumerate(key_frame.frame for key_frame in scene.key_frames):
        if key not in images:
            continue
        own = images[key].features
        seen: dict[int, list[tuple[int, FloatArray]]] = defaultdict(list)
        for f in found.nearest(key, config.max_frames):
            of_first, of_second = pairs[min(key, f), max(key, f)]
            mine, theirs = (of_first, of_second) if key < f else (of_second, of_first)
            for row, point_px in zip(mine.tolist(), images[f].features.points_px[theirs], strict=True):
                seen[row].append((f, point_px))
        for row in _longest(own, seen, _size(scene, key), config.max_tracks):
            key_frame.append(k)
            sigma.append(float(np.hypot(sigma_px, own.sigma_px)))
            observed.append(sorted([(key, own.points_px[row]), *seen[row]], key=lambda one: one[0]))
    return Tracks(
        key_frame=np.array(key_frame, dtype=np.int64),
        element=np.full(len(key_frame), -1),
        track=np.repeat(np.arange(len(observed)), [len(track) for track in observed]),
        frame=np.array([f for track in observed for f, _ in track], dtype=np.int64),
        points_px=np.array([point_px for track in observed for _, point_px in track]).reshape(-1, 2),
        sigma_px=np.array(sigma, dtype=np.float64),
        tried=(),
    )


def _stamp(frame: Frame, features: Features) -> tuple[object, ...]:
    """What tells the features of an image from others of the same extractor."""
    return frame.name, frame.image_path, features.sigma_px, len(features)


def _size(scene: Scene, frame: int) -> tuple[int, int]:
    camera = scene.frames[frame].camera
    return camera.width, camera.height


def _cells(points_px: FloatArray, size: tuple[int, int], count: int) -> IntArray:
    """(N,) which of about ``count`` square cells of an image each point lies in."""
    cell_px = np.sqrt(size[0] * size[1] / count)
    _, cell = np.unique(np.floor(points_px / cell_px).astype(np.int64), axis=0, return_inverse=True)
    return np.asarray(cell.ravel(), np.int64)


def _spread(features: Features, size: tuple[int, int], most: int) -> IntArray:
    """Indices, ascending, of at most ``most`` features, which come clearest first: first one of each cell, then two."""
    cell = _cells(features.points_px, size, most)
    order = np.argsort(cell, kind="stable")
    _, first, counts = np.unique(cell[order], return_index=True, return_counts=True)
    rank = np.empty(len(cell), dtype=np.int64)
    rank[order] = np.arange(len(cell)) - np.repeat(first, counts)
    return np.sort(np.argsort(rank, kind="stable")[:most])


@dataclass(frozen=True)
class _Image:
    """The features of an image, ready to be compared."""

    features: Features
    steps: npt.NDArray[np.float32]
    """(N, D) descriptors in whole steps."""
    squared: npt.NDArray[np.float32]
    """(N,) their squared lengths."""

    @classmethod
    def of(cls, features: Features) -> Self:
        steps = np.round(_STEPS * features.descriptors)
        return cls(features, steps, np.sum(steps * steps, axis=1))


def _matched(first: _Image, second: _Image, config: ImageMatchConfig) -> tuple[IntArray, IntArray]:
    """(n,) features of one image and (n,) those of another that they are."""
    nothing = np.empty(0, dtype=np.int64)
    a, b = first.features, second.features
    if min(len(a), len(b)) < config.min_matches:
        return nothing, nothing
    of_a, of_b = _most_alike(first, second, config.max_ratio)
    if len(of_a) < config.min_matches:
        return nothing, nothing
    tolerance_px = config.tolerance_sigmas * max(a.sigma_px, b.sigma_px)
    try:
        _, agree = cv2.findFundamentalMat(
            a.points_px[of_a], b.points_px[of_b], cv2.USAC_MAGSAC, tolerance_px, 0.999, config.iterations
        )
    except cv2.error:  # OpenCV 5.0 fails on some good points (an empty model): this pair is then not matched.
        agree = None
    kept: BoolArray = np.zeros(len(of_a), dtype=bool) if agree is None else agree.ravel() > 0
    if kept.sum() < max(config.min_matches, config.min_share * len(kept)):
        return nothing, nothing
    return of_a[kept], of_b[kept]


def _most_alike(a: _Image, b: _Image, max_ratio: float) -> tuple[IntArray, IntArray]:
    """(n,) features of one image and (n,) of another of which each is the most alike to the other, clearly so."""
    # All are whole numbers below 2²⁴: exact, in whatever order they are added. A row's own |a|² changes no comparison.
    aside = (-2 * a.steps) @ b.steps.T
    aside += b.squared
    every = np.arange(len(aside))
    partner = np.argmin(aside, axis=1)
    least = a.squared + aside[every, partner]
    aside[every, partner] = np.inf
    rows = np.flatnonzero(least < max_ratio**2 * (a.squared + aside.min(axis=1)))
    # Products with the few that are left are cheaper than columns of all products, which lie far apart in memory.
    back = np.argmin(a.squared - 2 * (b.steps[partner[rows]] @ a.steps.T), axis=1)
    mutual = back == rows
    return rows[mutual], partner[rows[mutual]]


def _longest(
    features: Features, seen: dict[int, list[tuple[int, FloatArray]]], size: tuple[int, int], most: int
) -> list[int]:
    """Of each cell of the image the feature that was seen in most other frames, if in two at least; ascending."""
    cell = _cells(features.points_px, size, most).tolist()
    longest: dict[int, int] = {}
    for row in sorted(seen, key=lambda row: (-len(seen[row]), row)):
        if len(seen[row]) > 1:
            longest.setdefault(cell[row], row)
    return sorted(longest.values())
