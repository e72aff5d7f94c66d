"""The results of all readers: posed images with their own lens model, raw annotations.

A new format is one file that fills these types and one entry in ``gtlayout.io``'s tuple of readers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

from gtlayout.errors import GtlayoutError
from gtlayout.extras import MissingExtraError
from gtlayout.io.archives import read_bytes
from gtlayout.io.image_names import FilesOnDisk
from gtlayout.io.lens import Lens
from gtlayout.io.pixels.registration import Pinhole
from gtlayout.scene import FloatArray, VideoFrame

S = TypeVar("S")
T = TypeVar("T")


@dataclass(frozen=True)
class PosedImage:
    """One image that a camera file knows."""

    name: str
    """Relative to the image folder, with forward slashes."""
    image_path: Path
    """Where the image should be; it may be missing, and is where ``video`` is given."""
    camera: Lens
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
    """Whether the format's unit is the metre; None = the format does not state it."""


@dataclass(frozen=True)
class RawShape:
    """One thing drawn in one image: pixels of that image, nothing repaired, the label as the file has it."""

    label: str
    polygons: tuple[FloatArray, ...] = ()
    """Outlines without holes, (N, 2) px each, that make it up together."""
    lines: tuple[FloatArray, ...] = ()
    """Polylines, (N, 2) px each; only occlusion edges have them."""
    visible: tuple[FloatArray, ...] = ()
    """Outlines of its visible parts, where the format keeps them with the element itself."""
    id: str | None = None
    """Of an element. Elements of an image with the same id and label are parts of one."""
    element: str | None = None
    """Of a visible part: id of the element it belongs to."""
    group: str | None = None
    """Elements of a group with the same label are parts of one; a visible part belongs to one of its group."""
    z_order: int = 0
    """Where elements that bound the room overlap, the higher one is in front."""
    curved: bool = False
    """Whether it is said to be curved."""


@dataclass(frozen=True)
class RawKeyFrame:
    """One annotated image."""

    image: str
    """As the file calls it: a path, a file name, with or without its ending."""
    shapes: tuple[RawShape, ...]
    image_size: tuple[int, int] | None
    """(width, height) px of the image that was annotated; None = not said."""
    number: int | None = None
    """Place among the images of the task that was annotated, from 0 on; None = not known."""
    video_number: int | None = None
    """Place in the video that the task's images were taken from, from 0 on; None = not known, or of no video."""


@dataclass(frozen=True)
class RawAnnotations:
    """An annotation file, read."""

    path: Path
    key_frames: tuple[RawKeyFrame, ...]
    warnings: tuple[str, ...] = ()
    sequence_length: int | None = None
    """How many images ``RawKeyFrame.number`` counts; None = not known."""
    of_video: bool | None = None
    """Whether these are frames of a video, in order of time, or image files, in order of names; None = not known."""
    is_part_of_video: bool = False
    """Whether they are known to be some of a video's frames only."""
    listed: tuple[str, ...] = ()
    """Names of all images that the file lists, annotated or not, where it lists those, too."""
    notes: tuple[str, ...] = ()
    """What is left out because it is meant to be: proposals that nobody has confirmed, one line each kind."""


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
    recognise: Callable[[Path], list[Path]] = lambda _path: []
    """A file or folder that a user named, and that ``detect`` does not know by its name → what ``read`` takes of it;
    none when it is of another format."""
    in_parts: bool = False
    """Whether several of them in one scene are parts or stages of one, of which the largest counts."""


def named(name: str) -> Callable[[Path], list[Path]]:
    """Detects the file or folder of that name in a scene folder."""

    def detect(root: Path) -> list[Path]:
        path = root / name
        return [path] if path.exists() else []

    return detect


def json_with(*keys: str) -> Callable[[Path], list[Path]]:
    """Recognises a JSON object with these keys in it or in what it lists, whatever the file is called."""

    def recognise(path: Path) -> list[Path]:
        if not path.is_file() or path.suffix.lower() != ".json":
            return []
        text = read_bytes(path)
        return [path] if all(f'"{key}"'.encode() in text for key in keys) else []

    return recognise


def on_disk(images: Sequence[PosedImage], files: FilesOnDisk) -> list[PosedImage]:
    """The images, those whose file is spelled otherwise on disk with the path that it has."""
    paths = files.find_each([[] if image.video is not None else [image.image_path] for image in images])
    return [replace(image, image_path=path) if path else image for image, path in zip(images, paths, strict=True)]


def usable(entries: Sequence[S], read: Callable[[S], T]) -> tuple[list[T], tuple[str, ...]]:
    """Cameras as ``read`` makes them of ``entries``, and a warning that counts those it raised GtlayoutError for.

    Raises the first of these errors when nothing is left, and at once where a package is missing.
    """
    found, problems = [], []
    for entry in entries:
        try:
            found.append(read(entry))
        except MissingExtraError:
            raise
        except GtlayoutError as error:
            problems.append(error.with_traceback(None))  # which holds what was read of the file
    if problems and not found:
        raise problems[0]
    count = f"{len(problems)} of {len(entries)} cameras cannot be used and were skipped, first: "
    return found, (count + str(problems[0]),) if problems else ()
