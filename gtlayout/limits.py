"""Bounds on what is read: no file takes all memory or time. A variable of the environment raises each."""

from __future__ import annotations

import os
from dataclasses import dataclass

from gtlayout.errors import GtlayoutError


@dataclass(frozen=True)
class Limit:
    """The most of something that is read."""

    what: str
    """Follows a number in messages."""
    variable: str
    """Of the environment."""
    default: int

    @property
    def most(self) -> int:
        """The variable's value where it is a whole number, else the default."""
        given = os.environ.get(self.variable, "")
        return int(given) if given.isascii() and given.isdecimal() and len(given) < 10 else self.default

    def exceeded(self, number: float) -> str | None:
        """What to say of a number that is too large; None when it is not."""
        if number <= self.most:
            return None
        return f"more than {self.most:,} {self.what}: set {self.variable} to read more"

    def check(self, number: float, where: str) -> None:
        """Raise GtlayoutError, beginning with ``where``, when the number is too large."""
        if why := self.exceeded(number):
            raise GtlayoutError(f"{where}: {why}")


FILE_MB = Limit("MB", "GTLAYOUT_MAX_FILE_MB", 256)
"""Of any file that is read whole: a text, JSON, which takes ten times that in memory, an image."""
MODEL_MB = Limit("MB", "GTLAYOUT_MAX_MODEL_MB", 4_000)
"""Of each file of a binary COLMAP model, which holds all that was matched."""
IMAGE_MP = Limit("megapixels", "GTLAYOUT_MAX_IMAGE_MP", 128)
"""Of an image file; a few bytes can claim far more."""
VIDEO_MP = Limit("megapixels a frame", "GTLAYOUT_MAX_VIDEO_MP", 67)
"""Of a video: twice 8K."""
FRAMES = Limit("frames", "GTLAYOUT_MAX_FRAMES", 50_000)
"""Of a scene: half an hour at 30 Hz."""
ELEMENTS = Limit("elements in one frame", "GTLAYOUT_MAX_ELEMENTS", 1_000)
"""No room has so many surfaces."""
