"""The images of a COLMAP model in text form: ``cameras.txt`` and ``images.txt``, line by line.

The layout is that of COLMAP's own reader (reconstruction_io_text.cc), which ends a name at its first blank, fails as a
whole on one line that is damaged, and takes a byte-order mark for data. Other programs write names with blanks
(RealityScan), or leave out the empty second line of an image without points.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gtlayout.errors import GtlayoutError
from gtlayout.io.archives import read_text
from gtlayout.io.lens import PARAMETERS, Lens
from gtlayout.io.sources import usable
from gtlayout.scene import FloatArray

FIELDS = 10
"""IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME: the rest of the line."""
Line = tuple[str, str]
"""What to call a line, and the line."""


@dataclass(frozen=True)
class ModelImage:
    """One image with a pose."""

    number: int
    name: str
    camera: Lens
    camera_number: int
    cam_from_world: FloatArray
    """(3, 4)"""


def read_images(model: Path) -> tuple[list[ModelImage], tuple[str, ...]]:
    """The images in the text files of folder ``model``, and a warning that counts those that were skipped.

    Quaternions are made unit length, as COLMAP does. Raises GtlayoutError naming the file when no image is left.
    """
    file = model / "images.txt"
    cameras = _cameras(model / "cameras.txt")
    lines = _image_lines(file)
    if not lines:
        raise GtlayoutError(f"{file} holds no image with a pose")
    images, warnings = usable(lines, lambda line: _image(line, cameras, model / "cameras.txt"))
    announced = _announced(file)
    if len(lines) < announced:
        warnings = (f"{file} announces {announced} images and holds {len(lines)}: it was cut off", *warnings)
    return images, warnings


def _announced(file: Path) -> int:
    """How many images COLMAP says, in a comment, that it wrote; 0 where it does not."""
    beginning = file.read_text(encoding="utf-8-sig", errors="surrogateescape")[:1000]
    found = re.search(r"^# Number of images: (\d{1,9})\b", beginning, re.MULTILINE)
    return int(found[1]) if found else 0


def _cameras(file: Path) -> dict[int, Lens | GtlayoutError]:
    """By number, each camera, or what is wrong with its line."""
    found: dict[int, Lens | GtlayoutError] = {}
    for where, line in _lines(file):
        words = line.split()
        if not words or not words[0].isdecimal():
            continue  # Without a number no image can mean it.
        try:
            width, height, *params = int(words[2]), int(words[3]), *map(float, words[4:])
            if words[1] not in PARAMETERS or len(params) != len(PARAMETERS[words[1]]) or min(width, height) < 0:
                raise ValueError
            found[int(words[0])] = Lens(words[1], width, height, tuple(params))
        except (ValueError, IndexError, TypeError, OverflowError):
            found[int(words[0])] = GtlayoutError(f"{where} is no camera: {line[:80]!r}")
    return found


def _image_lines(file: Path) -> list[Line]:
    """The first line of each image. Its second holds its points, and may be empty or missing."""
    found, first = [], True
    for where, line in _lines(file, blank=True):
        if line and (first or _is_image(line)):
            found.append((where, line))
            first = False
        else:
            first = True
    return found


def _is_image(line: str) -> bool:
    """Whether a line is an image's first, where its points are expected: these are numbers only."""
    words = line.split(maxsplit=FIELDS - 1)
    return len(words) == FIELDS and _numbers(words[:-1]) is not None and _numbers(words[-1].split()) is None


def _image(line: Line, cameras: dict[int, Lens | GtlayoutError], file: Path) -> ModelImage:
    where, text = line
    words = text.split(maxsplit=FIELDS - 1)
    numbers = _numbers(words[: FIELDS - 1])
    if len(words) < FIELDS or numbers is None or not (words[0] + words[8]).isdecimal():
        raise GtlayoutError(
            f"{where} is no image (IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME): {text[:80]!r}"
        )
    camera = cameras.get(int(words[8]))
    if camera is None:
        raise GtlayoutError(f"{where}: no camera {words[8]} in {file}")
    if isinstance(camera, GtlayoutError):
        raise camera
    w, x, y, z = numbers[1:5]
    try:
        rotation = Rotation.from_quat([x, y, z, w]).as_matrix()
    except ValueError as error:
        raise GtlayoutError(f"{where}: the quaternion is of length 0") from error
    return ModelImage(int(words[0]), words[-1], camera, int(words[8]), np.column_stack([rotation, numbers[5:8]]))


def _lines(file: Path, *, blank: bool = False) -> list[Line]:
    """The lines without blanks around them and without comments; empty ones where ``blank``."""
    # What is no UTF-8 costs the name it is in.
    stripped = [line.strip() for line in read_text(file, "surrogateescape").split("\n")]
    return [
        (f"{file}, line {number}", line)
        for number, line in enumerate(stripped, start=1)
        if not line.startswith("#") and (line or blank)
    ]


def _numbers(words: list[str]) -> FloatArray | None:
    """Finite numbers; None when a word is none."""
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        return None
    return values if np.all(np.isfinite(values)) else None
