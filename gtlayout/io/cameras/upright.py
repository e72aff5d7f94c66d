"""Images with an orientation tag: from the file as it is stored to a frame that stands upright."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.pixels.turn import AS_STORED, Header, Turn, read_header
from gtlayout.io.sources import PosedImage
from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class Upright:
    """From an image file with an orientation tag to the pinhole image of its frame.

    Stored pixels are turned to those the camera file is about (``before``), undistorted, and turned upright
    (``after``): camera files are about the pixels as stored, unless their size is that of the shown image.
    """

    shown: Turn
    """From the stored pixels to those that a viewer shows, and an annotator sees."""
    width: int
    """Of the image file as stored, px."""
    height: int
    lenses: tuple[Undistortion, ...]
    """One, or none when the camera is a pinhole; more where an undistorted image was given another lens."""
    before: Turn
    after: Turn

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) px of the image file as stored."""
        return self.width, self.height

    @property
    def shown_size(self) -> tuple[int, int]:
        """(width, height) px as a viewer shows the image."""
        return self.shown.size(self.size)

    @property
    def seen_size(self) -> tuple[int, int]:
        """(width, height) px of the undistorted image, before it is turned upright."""
        if not self.lenses:
            return self.before.size(self.size)
        return int(self.lenses[-1].target.width), int(self.lenses[-1].target.height)

    def from_shown(self, shown_px: FloatArray) -> FloatArray:
        """(N, 2) pixels of the image as shown → (N, 2) of the file as stored."""
        return self.shown.inverse.points(shown_px, self.shown_size)

    def points(self, stored_px: FloatArray) -> FloatArray:
        """(N, 2) pixels of the file as stored → (N, 2) of the frame; NaN where the lens has no inverse."""
        seen_px = self.before.points(stored_px, self.size)
        for lens in self.lenses:
            seen_px = lens.points(seen_px)
        return self.after.points(seen_px, self.seen_size)

    def stored(self, points_px: FloatArray) -> FloatArray:
        """The inverse of ``points``: (N, 2) pixels of the frame → (N, 2) of the file as stored."""
        seen_px = self.after.inverse.points(points_px, self.after.size(self.seen_size))
        for lens in reversed(self.lenses):
            seen_px = lens.distorted(seen_px)
        return self.before.inverse.points(seen_px, self.before.size(self.size))

    def __call__(self, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Pixels (or a depth map) as stored → those of the frame. Raises GtlayoutError on another size."""
        if image.shape[:2] != (self.height, self.width):
            raise GtlayoutError(f"{image.shape[1]}x{image.shape[0]} px, its camera says {self.width}x{self.height}")
        seen = self.before.image(image)
        for lens in self.lenses:
            seen = lens(seen)
        return self.after.image(seen)


@dataclass(frozen=True)
class Turned:
    """What ``resample`` makes of an image, turned."""

    resample: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]
    turn: Turn

    def __call__(self, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Resample and turn. Raises what ``resample`` does."""
        return self.turn.image(self.resample(image))


def header_with_tag(image: PosedImage) -> Header | None:
    """What the image file says of its orientation; None where it says nothing, or is no file."""
    header = read_header(image.image_path) if image.video is None else None
    return header if header and header.turn != AS_STORED else None


def is_of_shown(image: PosedImage, header: Header | None) -> bool:
    """Whether the size of the image's camera says that it is of the image as shown, and not as stored.

    It is when the one is upright and the other on its side: the camera may be for images of another size.
    """
    if header is None or not header.turn.swaps_axes:
        return False
    width, height = header.size
    return (image.camera.width - image.camera.height) * (width - height) < 0


def size_seen(image: PosedImage, header: Header) -> tuple[int, int]:
    """(width, height) px of the image that the camera is of: as shown or as stored."""
    return header.shown_size if is_of_shown(image, header) else header.size


def upright(header: Header, lens: Undistortion | None, *, of_shown: bool) -> Upright:
    """The way of an image to its frame, whose camera is of the image as shown or as stored.

    A mirrored image stays as stored: no camera sees a mirrored room.
    """
    before = header.turn if of_shown else AS_STORED
    after = AS_STORED if of_shown or header.turn.is_mirrored else header.turn
    return Upright(header.turn, *header.size, (lens,) if lens else (), before, after)


def orientation_lines(images: Sequence[PosedImage], headers: Sequence[Header | None]) -> list[str]:
    """One line per orientation and reading of the cameras: how it was read, and how sure that is."""
    groups: dict[tuple[str, bool], list[PosedImage]] = defaultdict(list)
    for image, header in zip(images, headers, strict=True):
        if header is not None:
            groups[header.turn.says(), is_of_shown(image, header)].append(image)
    return [
        f"{len(group)} images have an orientation tag (EXIF): {says} when shown, first {group[0].image_path}; their "
        + (
            "cameras are of the images as shown, by their size"
            if of_shown
            else "cameras are taken to be of the pixels as stored, which COLMAP and nerfstudio read"
        )
        for (says, of_shown), group in groups.items()
    ]
