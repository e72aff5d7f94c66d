"""Images as COLMAP can read them, under names that its files can hold."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import cv2
from PIL import Image

from gtlayout.io.files import write_atomic
from gtlayout.io.pixels.images import decode, encoded

READ_BY_COLMAP = ("JPEG", "MPO", "PNG", "TIFF", "BMP")
"""Pillow's names of what every build of COLMAP reads; MPO are a phone's JPEG files that hold a second image."""


def for_colmap(images: Path, names: Sequence[str], work: Path) -> tuple[Path, tuple[str, ...]]:
    """A folder that holds the images ``names`` of folder ``images`` for COLMAP, and what they are called there.

    That is the folder itself where COLMAP can read all of them. Else it is a new one in ``work`` with numbers for
    names: COLMAP's lists of pairs end a name at a blank, and its images cannot be WebP or HEIC.
    Raises GtlayoutError when an image cannot be read or written.
    """
    readable = {name: _is_readable(images / name) for name in names}
    if all(readable.values()) and not any(re.search(r"\s", name) for name in names):
        return images, tuple(names)
    folder, called = work / "for_colmap", []
    for number, name in enumerate(names):
        path = folder / f"{number:06d}{(images / name).suffix.lower() if readable[name] else '.png'}"
        if readable[name]:
            write_atomic(path, (images / name).read_bytes())
        else:
            write_atomic(path, encoded(".png", decode(images / name, cv2.IMREAD_COLOR)))
        called.append(path.name)
    return folder, tuple(called)


def _is_readable(path: Path) -> bool:
    try:
        with Image.open(path) as image:
            return image.format in READ_BY_COLMAP
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return False
