"""Stage 1, beside the tracks: features of whole images matched by their looks alone, by which cameras are judged.

What is found along epipolar lines agrees with the cameras that the lines come from, be they right or wrong. Here two
images are matched without their cameras, furniture and all: only what their own matches agree on counts.
"""

from __future__ import annotations

from collections import defaultdict

import cv2
import numpy as np

from gtlayout.scene import BoolArray, FloatArray, IntArray, Scene
from gtlayout.tracking.config import ImageMatchConfig
from gtlayout.tracking.features import Features, VideoFeatures
from gtlayout.tracking.tracks import Tracks, joined

_STEPS = 255
"""Descriptors of unit length are rounded to so many steps: their products are then whole numbers below 2²⁴, which
single precision adds without rounding, in any order, on every processor."""


def camera_evidence(
    scene: Scene, found: VideoFeatures, followed: Tracks, sigma_px: float, config: ImageMatchConfig
) -> Tracks:
    """The tracks that cameras are judged by: matched features; where these are few, the ``followed`` points as well."""
    matched = match_images(scene, found, sigma_px, config)
    return matched if len(matched) >= config.enough_tracks else joined((matched, followed), ())


def match_images(scene: Scene, found: VideoFeatures, sigma_px: float, config: ImageMatchConfig) -> Tracks:
    """Tracks of features of the key frames, anywhere in the image, on no element (``Tracks.element`` is -1).

    ``sigma_px`` is the noise of their positions besides that of the features themselves.
    """
    images = {
        f: features.only(_spread(features, _size(scene, f), config.max_features))
        for f, features in found.of_frame.items()
    }
    pairs: dict[tuple[int, int], tuple[IntArray, IntArray]] = {}
    key_frame, observed, sigma = [], [], []
    for k, key in enumerate(key_frame.frame for key_frame in scene.key_frames):
        if key not in images:
            continue
        own = images[key]
        seen: dict[int, list[tuple[int, FloatArray]]] = defaultdict(list)
        for f in found.nearest(key, config.max_frames):
            first, second = min(key, f), max(key, f)
            if (first, second) not in pairs:
                pairs[first, second] = _matched(images[first], images[second], config)
            of_first, of_second = pairs[first, second]
            mine, theirs = (of_first, of_second) if key == first else (of_second, of_first)
            for row, point_px in zip(mine.tolist(), images[f].points_px[theirs], strict=True):
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


def _matched(a: Features, b: Features, config: ImageMatchConfig) -> tuple[IntArray, IntArray]:
    """(n,) features of one image and (n,) those of another that they are."""
    nothing = np.empty(0, dtype=np.int64)
    if min(len(a), len(b)) < config.min_matches:
        return nothing, nothing
    of_a, of_b = _most_alike(a, b, config.max_ratio)
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


def _most_alike(a: Features, b: Features, max_ratio: float) -> tuple[IntArray, IntArray]:
    """(n,) features of one image and (n,) of another of which each is the most alike to the other, clearly so."""
    in_steps = [np.round(_STEPS * features.descriptors) for features in (a, b)]
    squares = [np.sum(steps.astype(np.float64) ** 2, axis=1) for steps in in_steps]
    squared = squares[0][:, None] + squares[1] - 2.0 * (in_steps[0] @ in_steps[1].T)
    partner = np.argmin(squared, axis=1)
    rows = np.arange(len(a))
    least = squared[rows, partner]
    mutual = np.argmin(squared, axis=0)[partner] == rows
    squared[rows, partner] = np.inf
    found = mutual & (least < max_ratio**2 * squared.min(axis=1))
    return rows[found], partner[found]


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
