"""Images with an orientation tag, as cameras and phones write them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from PIL.ExifTags import Base as Tag

from gtlayout.io.pixels.turn import TURNS
from gtlayout.scene import ImageArray


def write_tagged(path: Path, shown_rgb: ImageArray, orientation: int) -> Path:
    """Write an image of any kind that Pillow writes: viewers show it as given, its pixels are stored turned."""
    stored = Image.fromarray(np.ascontiguousarray(TURNS[orientation - 1].inverse.image(shown_rgb)))
    exif = Image.Exif()
    exif[Tag.Orientation] = orientation
    path.parent.mkdir(parents=True, exist_ok=True)
    lossless = {"lossless": True} if path.suffix == ".webp" else {"quality": 95} if path.suffix == ".jpg" else {}
    stored.save(path, exif=exif, **lossless)
    return path


def shown_rgb(path: Path) -> ImageArray:
    """The image as OpenCV shows it, which turns it as its tag asks."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    assert image is not None
    return image.astype(np.uint8)
