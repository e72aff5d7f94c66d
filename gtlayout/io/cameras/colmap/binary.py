"""Whether a binary COLMAP model is as long as its counts say.

pycolmap believes a count and reads on past the end of the file: a model that was cut off keeps it busy for hours.
The layout of the files is that of COLMAP's own reader (reconstruction_io_binary.cc).
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable
from pathlib import Path

from gtlayout.errors import GtlayoutError
from gtlayout.io.lens import PARAMETERS
from gtlayout.limits import MODEL_MB

POSE = 7 * 8
"""Bytes of a quaternion and a translation."""
SENSOR = 4 + 4
"""Type and number."""


def check_lengths(model: Path) -> None:
    """Walk through the binary files of the model in folder ``model``, those that are there.

    Raises GtlayoutError naming the file that is shorter than what it says it holds, too large, or cannot be read.
    """
    for part, end_of_record in PARTS.items():
        file = model / f"{part}.bin"
        if not file.is_file():
            continue
        MODEL_MB.check(file.stat().st_size / 1e6, f"cannot read {file}")
        try:
            with file.open("rb") as opened, mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as data:
                (count,), at = struct.unpack_from("<Q", data), 8
                for _ in range(count):
                    at = end_of_record(data, at)
                    if at > len(data):
                        raise struct.error
        except OSError as error:
            raise GtlayoutError(f"cannot read {file}: {error.strerror or error}") from error
        except (struct.error, IndexError, ValueError, OverflowError) as error:
            raise GtlayoutError(f"{file} is cut off or damaged: it says it holds more than it does") from error


def _camera(data: mmap.mmap, at: int) -> int:
    model_id = struct.unpack_from("<i", data, at + 4)[0]
    return at + 4 + 4 + 2 * 8 + _parameters(model_id) * 8


def _image(data: mmap.mmap, at: int) -> int:
    end_of_name = data.find(b"\0", at + 4 + POSE + 4)
    if end_of_name < 0:
        raise struct.error
    points = struct.unpack_from("<Q", data, end_of_name + 1)[0]
    return end_of_name + 1 + 8 + points * (2 * 8 + 8)


def _point(data: mmap.mmap, at: int) -> int:
    before = 8 + 3 * 8 + 3 + 8
    return at + before + 8 + struct.unpack_from("<Q", data, at + before)[0] * (4 + 4)


def _rig(data: mmap.mmap, at: int) -> int:
    sensors = struct.unpack_from("<I", data, at + 4)[0]
    at += 4 + 4 + SENSOR * (sensors > 0)
    for _ in range(sensors - 1):
        at += SENSOR + 1 + POSE * (data[at + SENSOR] != 0)
    return at


def _frame(data: mmap.mmap, at: int) -> int:
    before = 4 + 4 + POSE
    return at + before + 4 + struct.unpack_from("<I", data, at + before)[0] * (SENSOR + 8)


PARTS: dict[str, Callable[[mmap.mmap, int], int]] = {
    "cameras": _camera,
    "images": _image,
    "points3D": _point,
    "rigs": _rig,
    "frames": _frame,
}
"""For each file, where the record that begins at an offset ends."""


def _parameters(model_id: int) -> int:
    """How many a camera model has. Raises ValueError for a model that does not exist."""
    if not 0 <= model_id < len(PARAMETERS):
        raise ValueError(model_id)
    return len(list(PARAMETERS.values())[model_id])
