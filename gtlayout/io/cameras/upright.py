"""Images with an orientation tag: from the file as it is stored to a frame that stands upright."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.pixels.turn import AS_STORED, Header, Turn
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


def upright(header: Header, lens: Undistortion | None, camera_size: tuple[int, int]) -> Upright:
    """The way of an image to its frame, for a camera file that says (width, height) px.

    A mirrored image stays as stored: no camera sees a mirrored room.
    """
    of_shown = camera_is_of_shown(header, camera_size)
    before = header.turn if of_shown else AS_STORED
    after = AS_STORED if of_shown or header.turn.is_mirrored else header.turn
    return Upright(header.turn, *header.size, (lens,) if lens else (), before, after)


def camera_is_of_shown(header: Header, camera_size: tuple[int, int]) -> bool:
    """Whether a camera's size says that it is of the image as shown, and not as stored."""
    return camera_size != header.size and camera_size == header.turn.size(header.size)
