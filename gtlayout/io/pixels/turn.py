"""How an image is meant to be seen: its orientation tag (EXIF), and the quarter turns and mirrorings it stands for."""

from __future__ import annotations

import logging
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from PIL import Image
from PIL.ExifTags import Base as Tag

from gtlayout.scene import Camera, FloatArray

# What is odd about a file is said by whoever reads it; Pillow would print lines of its own.
logging.getLogger("PIL").addHandler(logging.NullHandler())

T = TypeVar("T", bound=np.generic)

SWAPPED_BY_PILLOW = ("TIFF",)
"""Pillow gives the size of these as it shows them, that of others as they are stored."""


@dataclass(frozen=True)
class Turn:
    """How stored pixels become those that are shown: the axes are swapped first, then x and y turned round."""

    swaps_axes: bool = False
    flips_x: bool = False
    flips_y: bool = False

    @property
    def is_mirrored(self) -> bool:
        """Whether a text in the image changes between readable and mirror writing: no camera can be turned so."""
        return self.swaps_axes ^ self.flips_x ^ self.flips_y

    @property
    def inverse(self) -> Turn:
        """From shown pixels to stored ones."""
        return Turn(True, self.flips_y, self.flips_x) if self.swaps_axes else self

    def says(self) -> str:
        """What it does, in words."""
        if self.is_mirrored:
            return "mirrored"
        if not self.swaps_axes:
            return "turned by 180°" if self.flips_x else "upright"
        return f"turned by 90° {'clockwise' if self.flips_x else 'anticlockwise'}"

    def size(self, stored: tuple[int, int]) -> tuple[int, int]:
        """(width, height) px as shown, of an image that is stored with (width, height) px."""
        return (stored[1], stored[0]) if self.swaps_axes else stored

    def image(self, stored: npt.NDArray[T]) -> npt.NDArray[T]:
        """(H, W, …) pixels as shown; of any type, so depth maps, too."""
        turned = stored.swapaxes(0, 1) if self.swaps_axes else stored
        return np.ascontiguousarray(turned[:: -1 if self.flips_y else 1, :: -1 if self.flips_x else 1])

    def points(self, stored_px: FloatArray, stored: tuple[int, int]) -> FloatArray:
        """(N, 2) pixels of an image stored with (width, height) px → (N, 2) of the shown one, both from a corner on."""
        width, height = self.size(stored)
        x, y = stored_px.T[::-1] if self.swaps_axes else stored_px.T
        return np.column_stack([width - x if self.flips_x else x, height - y if self.flips_y else y])

    def camera(self, stored: Camera) -> Camera:
        """The camera of the shown image. Only for turns that are not mirrored."""
        assert not self.is_mirrored
        axes = np.eye(2)[::-1] if self.swaps_axes else np.eye(2)
        axes = np.diag([-1.0 if self.flips_x else 1.0, -1.0 if self.flips_y else 1.0]) @ axes
        turn = np.eye(3)
        turn[:2, :2] = axes
        K = np.eye(3)
        K[:2, :2] = axes @ stored.K[:2, :2] @ axes.T
        K[:2, 2] = self.points(stored.K[None, :2, 2], (stored.width, stored.height))[0]
        width, height = self.size((stored.width, stored.height))
        return Camera(K, turn @ stored.R_cam_from_world, turn @ stored.t_cam_from_world, width, height)


AS_STORED = Turn()
TURNS = (
    AS_STORED,
    Turn(flips_x=True),
    Turn(flips_x=True, flips_y=True),
    Turn(flips_y=True),
    Turn(swaps_axes=True),
    Turn(swaps_axes=True, flips_x=True),
    Turn(swaps_axes=True, flips_x=True, flips_y=True),
    Turn(swaps_axes=True, flips_y=True),
)
"""What the values 1 to 8 of the tag stand for (EXIF 2.32, tag 274; TIFF 6.0)."""


@dataclass(frozen=True)
class Header:
    """What the beginning of an image file says."""

    turn: Turn
    """From the stored pixels to the shown ones."""
    size: tuple[int, int]
    """(width, height) px as stored."""

    @property
    def shown_size(self) -> tuple[int, int]:
        """(width, height) px as a viewer shows the image."""
        return self.turn.size(self.size)


def read_header(path: Path) -> Header | None:
    """The orientation and the stored size of an image file; None when it is no image.

    A tag that is damaged, or has a value that does not exist, counts as none, as viewers do it.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged tags, and of large images
            with Image.open(path) as image:
                size, swapped = image.size, image.format in SWAPPED_BY_PILLOW
                try:
                    value = image.getexif().get(Tag.Orientation, 1)
                except Exception:  # Pillow raises what its parsers raise: struct.error, KeyError, ValueError, …
                    value = 1
    except Exception:  # … and here, too. Whether the image can be read is said when its pixels are.
        return None
    turn = TURNS[value - 1] if isinstance(value, int) and 1 <= value <= len(TURNS) else AS_STORED
    return Header(turn, turn.inverse.size(size) if swapped else size)
