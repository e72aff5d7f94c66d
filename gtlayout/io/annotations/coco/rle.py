"""COCO's run lengths → outlines, without ever unpacking the mask: what a file says of its size costs nothing.

Facts are from COCO's "Data format" page and the comments of its mask API: runs go down the columns, pixels outside
first; compressed, a run is written in groups of 5 bits, the lowest first, each + 48 as a character, a sixth bit says
that more follow, and from the fourth run on it is the difference from the run before the last.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gtlayout.io.annotations.checked import UnusableError, image_size
from gtlayout.io.annotations.masks import boxes_polygons, simple_rings
from gtlayout.scene import FloatArray, IntArray

MAX_GROUPS = 8
"""40 bits, more than any count of pixels has."""


def rle_rings(rle: dict[str, Any], size: tuple[int, int] | None) -> tuple[FloatArray, ...]:
    """(N, 2) px rings without holes from ``{"size": [height, width], "counts": [...] or "..."}``.

    ``size`` is the image's (width, height) where it is known. Raises UnusableError.
    """
    stated = rle.get("size")
    own_size = image_size(stated[1], stated[0]) if isinstance(stated, list) and len(stated) == 2 else None
    if own_size is None:
        raise UnusableError("its mask has no size")
    if size is not None and own_size != size:
        raise UnusableError("its mask has another size than its image")
    width, height = own_size
    counts = rle.get("counts")
    runs = decompressed(counts) if isinstance(counts, str) else counts
    pixels = width * height
    if not isinstance(runs, list) or not all(type(run) is int and 0 <= run <= pixels for run in runs):
        raise UnusableError("its mask's runs are no counts of pixels")
    if sum(runs) != pixels:
        raise UnusableError("its mask's runs do not add up to its size")
    try:
        return tuple(simple_rings(boxes_polygons(_boxes(np.array(runs, dtype=np.int64), height))))
    except ValueError as error:
        raise UnusableError(f"its mask {error}") from error


def decompressed(text: str) -> list[int]:
    """The run lengths in a compressed string; raises UnusableError."""
    runs: list[int] = []
    value = groups = 0
    for sign in text:
        bits = ord(sign) - 48
        if not 0 <= bits < 64 or groups == MAX_GROUPS:
            raise UnusableError("its mask's runs are damaged")
        value |= (bits & 31) << 5 * groups
        groups += 1
        if not bits & 32:
            if bits & 16:
                value -= 1 << 5 * groups
            runs.append(value + (runs[-2] if len(runs) > 2 else 0))
            value = groups = 0
    if groups:
        raise UnusableError("its mask's runs are cut off")
    return runs


def _boxes(runs: IntArray, height: int) -> IntArray:
    """(N, 4) x0 y0 x1 y1: a run's first column, its last, and all between in one."""
    ends = np.cumsum(runs)
    inside = (np.arange(len(runs)) % 2 == 1) & (runs > 0)
    (first, top), (last, bottom) = np.divmod((ends - runs)[inside], height), np.divmod(ends[inside] - 1, height)
    bottom += 1
    more, between = last > first, last > first + 1
    zero, full = np.zeros_like(first), np.full_like(first, height)
    starts = np.column_stack([first, top, first + 1, np.where(more, full, bottom)])
    stops = np.column_stack([last, zero, last + 1, bottom])[more]
    middles = np.column_stack([first + 1, zero, last, full])[between]
    return np.concatenate([starts, stops, middles])
