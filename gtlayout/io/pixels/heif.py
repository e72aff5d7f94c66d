"""HEIC images, as phones of one maker write them: read through pillow-heif, which is an extra."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.limits import IMAGE_MP
from gtlayout.scene import ImageArray

SUFFIXES = (".heic", ".heif", ".hif")
BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
"""ISO 23008-12: what such a file begins with, after its length and ``ftyp``."""


def is_heif(data: bytes) -> bool:
    """Whether the first 12 bytes of a file are those of a HEIF image."""
    return data[4:8] == b"ftyp" and data[8:12] in BRANDS


def decode_heif(path: Path, data: bytes) -> ImageArray:
    """(H, W, 3) uint8 BGR, upright: how such an image is turned is part of its coding, its EXIF tag does not count.

    Raises GtlayoutError when pillow-heif is not installed or the image is damaged.
    """
    library = _library(path)
    try:
        image = library.open_heif(data, convert_hdr_to_8bit=True, bgr_mode=True)
        IMAGE_MP.check(image.size[0] * image.size[1] / 1e6, f"cannot read image {path}")
        pixels = np.asarray(image)
    except (ValueError, OSError, EOFError, SyntaxError, RuntimeError, MemoryError) as error:
        raise GtlayoutError(f"cannot read image {path}: damaged, or not an image ({error})") from error
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    return np.ascontiguousarray(pixels[:, :, :3], dtype=np.uint8)


def _library(path: Path) -> ModuleType:
    try:
        import pillow_heif
    except ImportError as error:
        raise GtlayoutError(
            f"cannot read image {path}: HEIC needs pillow-heif (pip install 'gtlayout[heic]'), or convert it to JPEG"
        ) from error
    return pillow_heif
