"""Local features of an image, which are matched by their looks over any distance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Protocol, Self

import cv2
import numpy as np
import numpy.typing as npt

from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.images import read_gray
from gtlayout.memory import Memory
from gtlayout.scene import FloatArray, Frame, ImageArray, IntArray, Scene
from gtlayout.threads import in_threads
from gtlayout.tracking.config import FeatureConfig

_DESCRIPTOR = 128
"""Numbers of a SIFT descriptor."""


@dataclass(frozen=True)
class Features:
    """N local features of one image."""

    points_px: FloatArray
    """(N, 2) position."""
    descriptors: npt.NDArray[np.float32]
    """(N, D) of unit length: the smaller the angle between two, the more alike they look."""
    sigma_px: float
    """σ of their positions."""

    def __len__(self) -> int:
        return len(self.points_px)

    def only(self, kept: IntArray) -> Features:
        """The features with indices ``kept``, in that order."""
        return Features(self.points_px[kept], self.descriptors[kept], self.sigma_px)


class FeatureExtractor(Protocol):
    """Finds the features of an image. SIFT below; learned ones fit as well."""

    def __call__(self, image: ImageArray) -> Features:
        """The features of a grey image, (H, W), the clearest first."""
        ...


@dataclass(frozen=True)
class VideoFeatures:
    """The features of some frames of a video."""

    of_frame: Mapping[int, Features]
    """By the number of the frame, ascending."""
    unreadable: tuple[str, ...] = ()
    """Names of the images that could not be read."""

    @classmethod
    def of(
        cls,
        scene: Scene,
        config: FeatureConfig,
        extractor: FeatureExtractor | None = None,
        memory: Memory | None = None,
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> Self:
        """Those of all key frames, and of ``config.spread_frames`` frames spread evenly over the video.

        ``memory`` keeps those of each frame, for one ``extractor``. ``progress`` is called with (frames done, frames in
        all).
        """
        memory = memory or Memory()
        extractor = extractor or SiftExtractor(config.contrast, config.max_side_px, config.sigma_px)
        spread = np.linspace(0, len(scene.frames) - 1, config.spread_frames).round().astype(np.int64)
        frames = np.union1d([key_frame.frame for key_frame in scene.key_frames], spread).astype(np.int64)
        wanted = [scene.frames[f] for f in frames]

        def found_in(frame: Frame) -> Features | None:
            return memory.of("features", (frame.name, frame.image_path, config), partial(_of, frame, extractor))

        of_frame, unreadable = {}, []
        # A video gives its frames in one order only; and who knows what another extractor bears.
        alone = any(frame.video is not None for frame in wanted) or not isinstance(extractor, SiftExtractor)
        each = in_threads(found_in, wanted, alone=alone)
        for f, frame, found in zip(frames.tolist(), wanted, each, strict=True):
            if found is None:
                unreadable.append(frame.name)
            else:
                of_frame[f] = found
            progress(len(of_frame) + len(unreadable), len(wanted))
        return cls(of_frame, tuple(unreadable))

    def nearest(self, key: int, most: int) -> list[int]:
        """The ``most`` frames with features that are nearest to frame ``key`` in time, without it, ascending."""
        return sorted(sorted((f for f in self.of_frame if f != key), key=lambda f: (abs(f - key), f))[:most])


def _of(frame: Frame, extractor: FeatureExtractor) -> Features | None:
    """The features of a frame; None when its image cannot be read."""
    try:
        image = read_gray(frame)
    except GtlayoutError:
        return None
    return extractor(image)


@dataclass(frozen=True)
class SiftExtractor:
    """OpenCV's SIFT (Lowe 2004) with the square roots of its histograms (RootSIFT, Arandjelović 2012)."""

    contrast: float
    """Least contrast of a feature, in OpenCV's unit; its default is 0.04."""
    max_side_px: int
    """Larger images are shrunk to this side before features are looked for."""
    sigma_px: float
    """σ of a position in the image that features are looked for in."""

    def __call__(self, image: ImageArray) -> Features:
        """See ``FeatureExtractor``."""
        shrink = min(1.0, self.max_side_px / max(image.shape))
        height, width = (max(1, round(shrink * side)) for side in image.shape)
        small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA) if shrink < 1 else image
        key_points, histograms = cv2.SIFT.create(contrastThreshold=self.contrast).detectAndCompute(small, None)
        if len(key_points) == 0:
            return Features(np.empty((0, 2)), np.empty((0, _DESCRIPTOR), dtype=np.float32), self.sigma_px / shrink)
        in_small_px = np.array([point.pt for point in key_points], dtype=np.float64) + 0.5
        clearness = np.array([point.response for point in key_points])
        # Rounded, they are whole numbers on every processor.
        counts = np.round(histograms).astype(np.float64)
        unit = np.sqrt(counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)).astype(np.float32)
        order = _clearest_first(clearness, in_small_px)
        points_px = in_small_px * (np.array(image.shape[::-1]) / (width, height))
        return Features(points_px[order], unit[order], self.sigma_px / shrink)


def _clearest_first(clearness: FloatArray, points_px: FloatArray) -> IntArray:
    """(N,) order of features; equal ones from left to right."""
    return np.lexsort((points_px[:, 1], points_px[:, 0], -clearness))
