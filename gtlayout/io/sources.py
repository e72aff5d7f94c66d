"""What a reader hands over, whatever the format: posed images with their own lens model, raw annotations.

A new format is one file that fills these types and one entry in ``gtlayout.io``'s tuple of readers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import pycolmap

from gtlayout.io.registration import Pinhole
from gtlayout.scene import FloatArray, VideoFrame

T = TypeVar("T")


@dataclass(frozen=True)
class PosedImage:
    """One image that a camera file knows."""

    name: str
    """Relative to the image folder, with forward slashes."""
    image_path: Path
    """Where the image should be; it may be missing, and is where ``video`` is given."""
    camera: pycolmap.Camera
    """Lens model of the image file: any of COLMAP's, pixel centres at +0.5."""
    R_cam_from_world: FloatArray
    """(3, 3) rotation."""
    t_cam_from_world: FloatArray
    """(3,) translation, world unit."""
    depth_path: Path | None = None
    """Depth map the camera file names for it; None = look in ``depth/``."""
    depth_camera: Pinhole | None = None
    """Camera of the depth map, with the image's pose; None = the depth map is like the image file."""
    video: VideoFrame | None = None
    """Where the pixels are when there is no image file."""

    @property
    def is_there(self) -> bool:
        """Whether there is an image file, or a frame of a video instead."""
        return self.video is not None or self.image_path.is_file()


@dataclass(frozen=True)
class PosedImages:
    """A camera file, read."""

    images: tuple[PosedImage, ...]
    warnings: tuple[str, ...] = ()
    metric: bool | None = None
    """Whether the format's unit is the metre; None = it does not say."""


@dataclass(frozen=True)
class RawElement:
    """An element as drawn: pixels of the image file, nothing repaired."""

    id: str
    label: str
    polygons: tuple[FloatArray, ...]
    """Amodal polygons, (N, 2) px each."""
    visible: tuple[FloatArray, ...]
    """Visible parts, (N, 2) px each."""


@dataclass(frozen=True)
class RawKeyFrame:
    """One annotated image."""

    image: str
    elements: tuple[RawElement, ...]
    occlusion_edges: tuple[FloatArray, ...]
    """Polylines, (N, 2) px each."""
    image_size: tuple[int, int] | None
    """(width, height) px of the image that was annotated; None = not said."""


@dataclass(frozen=True)
class RawAnnotations:
    """An annotation file, read."""

    path: Path
    key_frames: tuple[RawKeyFrame, ...]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reader(Generic[T]):
    """One format."""

    name: str
    looked_for: str
    """What ``detect`` looks for, in words."""
    detect: Callable[[Path], list[Path]]
    """Scene folder → the files or folders of this format in it."""
    read: Callable[[Path, Path], T]
    """(scene folder, the one detected path) → the data; raises GtlayoutError."""
