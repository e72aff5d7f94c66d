"""One pass over the video: images that are damaged, dark or repeated, and points followed to compare cameras with."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.images import read_gray
from gtlayout.scene import FloatArray, ImageArray, Scene
from gtlayout.tracking.config import TrackingConfig
from gtlayout.tracking.klt import KltTracker

MAX_STARTS = 12
"""Frames spread over the video, and as many key frames, from which points are followed."""
MAX_STEPS = 10
"""Frames they are followed."""
POINTS = 300
MIN_POINTS = 30
"""With fewer points two cameras are not compared."""
MIN_SURVIVING = 0.5
"""Points are followed as long as so many of those that reached the next frame survive: later ones are the odd ones."""
CORNER_QUALITY = 0.01
"""Weakest corner taken, as a share of the image's best."""
REPEATED = 3
"""So many times the same picture is no chance; twice it happens when a video's frame rate is changed."""
DARK = 8.0
"""Mean grey value (of 255) below which an image shows nothing."""


@dataclass(frozen=True)
class Matches:
    """Points of one frame found in a later one."""

    source: int
    """Index into ``Scene.frames``."""
    target: int
    source_px: FloatArray
    """(N, 2)"""
    target_px: FloatArray
    """(N, 2)"""
    between: tuple[tuple[int, FloatArray], ...] = ()
    """Frames on the way, and (N, 2) where the points are in each."""


@dataclass(frozen=True)
class Seen:
    """What was found in the images."""

    lines: list[str]
    """Suspicious images, one line each."""
    matches: list[Matches]
    """Of one pair of frames each, as far apart as points could be followed."""


def look_through(scene: Scene, progress: Callable[[int, int], None]) -> Seen:
    """Decode every image once and follow points from some of them, without looking at the cameras' poses."""
    annotated = {key_frame.frame for key_frame in scene.key_frames}
    starts = _starts(scene)
    lines: list[str] = []
    same: dict[bytes, list[str]] = defaultdict(list)
    following: list[_Chain] = []
    ended: list[_Chain] = []
    progress(0, len(scene.frames))
    for i, frame in enumerate(scene.frames):
        try:
            image = read_gray(frame)
        except GtlayoutError as error:
            lines.append(f"{error}; {'it is annotated: mend it' if i in annotated else 'the frame is stepped over'}")
            progress(i + 1, len(scene.frames))
            continue
        same[hashlib.sha256(image.tobytes()).digest()].append(frame.name)
        if i in annotated and image.mean() < DARK:
            lines.append(f"{frame.name}: annotated, but nearly black")
        following = [chain.followed(image, i) for chain in following]
        ended += [chain for chain in following if chain.ended]
        following = [chain for chain in following if not chain.ended]
        if i in starts:
            following.append(_Chain.begun(image, i))
        progress(i + 1, len(scene.frames))
    lines += [
        f"{names[0]} to {names[-1]}: {len(names)} files hold the same picture; did the video stop, or its export?"
        for names in same.values()
        if len(names) >= REPEATED
    ]
    chains = sorted((*ended, *following), key=lambda chain: chain.start)
    lost = [scene.frames[chain.start].name for chain in chains if not chain.survivors]
    if 2 * len(lost) > len(chains):
        lines.append(
            f"points could be followed to the next frame from {len(chains) - len(lost)} of {len(chains)} frames only, "
            f"first lost in {lost[0]}: frames too far apart, not in the order of the video, blurred or without texture"
        )
    return Seen(lines, [chain.matches() for chain in chains if chain.survivors])


@dataclass(frozen=True)
class _Chain:
    """Points on their way through the video."""

    start: int
    source_px: FloatArray
    """(N, 2) in frame ``start``."""
    frame: int
    """Index of the frame they are in."""
    image: ImageArray
    """That frame's."""
    points_px: FloatArray
    """(N, 2) where they are in it."""
    between: tuple[tuple[int, FloatArray], ...] = ()
    """Frames after ``start`` and before ``frame``, and (N, 2) where the points are in each."""
    survivors: int = 0
    """How many reached the frame after ``start``; 0 before that, and when it was too few."""
    ended: bool = False

    @classmethod
    def begun(cls, image: ImageArray, frame: int) -> _Chain:
        config = TrackingConfig()
        corners = cv2.goodFeaturesToTrack(
            image, POINTS, CORNER_QUALITY, config.corner_distance_px, blockSize=config.corner_block_px
        )
        points_px = np.empty((0, 2)) if corners is None else corners.reshape(-1, 2).astype(np.float64) + 0.5
        return cls(frame, points_px, frame, image, points_px)

    def followed(self, next_image: ImageArray, next_frame: int) -> _Chain:
        """The same one step on; as it was where another camera took the image, ended when too few points survive."""
        if next_image.shape != self.image.shape:
            return self
        config = TrackingConfig()
        tracker = KltTracker(config.window_px, config.levels, config.max_forward_backward_px)
        moved, ok = tracker(self.image, next_image, self.points_px, self.points_px)
        height, width = next_image.shape
        ok &= np.all((moved > config.border_px) & (moved < np.array([width, height]) - config.border_px), axis=1)
        count = int(np.count_nonzero(ok))
        if count < max(MIN_POINTS, MIN_SURVIVING * self.survivors):
            return replace(self, ended=True)
        on_the_way = (*self.between, (self.frame, self.points_px)) if self.survivors else ()
        return _Chain(
            self.start,
            self.source_px[ok],
            next_frame,
            next_image,
            moved[ok],
            tuple((frame, points_px[ok]) for frame, points_px in on_the_way),
            self.survivors or count,
            next_frame - self.start >= MAX_STEPS,
        )

    def matches(self) -> Matches:
        return Matches(self.start, self.frame, self.source_px, self.points_px, self.between)


def _starts(scene: Scene) -> set[int]:
    """Frames over all the video, and key frames: what is annotated matters most."""
    key_frames = np.array([key_frame.frame for key_frame in scene.key_frames])
    chosen = key_frames[np.linspace(0, len(key_frames) - 1, min(MAX_STARTS, len(key_frames))).round().astype(int)]
    last = max(len(scene.frames) - 1 - MAX_STEPS // 2, 0)
    spread = np.linspace(0, last, MAX_STARTS).round().astype(int)
    return {int(frame) for frame in (*chosen, *spread) if frame < len(scene.frames) - 1}
