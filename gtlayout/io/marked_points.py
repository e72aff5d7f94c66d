"""Points of the room that people mark in images, as files have them: ``{"a.jpg": [x, y], "b.jpg": [x, y]}``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.marked_points import Mark
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.cameras.upright import Upright
from gtlayout.io.image_names import NameIndex
from gtlayout.scene import Frame

FORM = '{"metres": 2.03, "points": [{"IMAGE": [x, y], "IMAGE": [x, y]}, {…}]}'


def marks_of(point: Any, frames: Sequence[Frame], names: NameIndex, where: str) -> list[Mark]:
    """A point's pixels in two or more frames, in the image as a viewer shows it, (0, 0) the top-left corner.

    Raises GtlayoutError, beginning with ``where`` and naming the frame, when the content is not valid.
    """
    if not isinstance(point, dict) or len(point) < 2:
        raise GtlayoutError(f"{where} must be marked in two or more frames: {FORM}")
    marks = []
    for name, value in point.items():
        match = names.find(name)
        if match is None or len(match.places) > 1:
            no = "no frame" if match is None else "more than one frame"
            raise GtlayoutError(f"{where}: {no} {name} in the scene; its frames are called {frames[0].name} and so on")
        frame = frames[match.places[0]]
        if not isinstance(value, list) or len(value) != 2 or not all(map(_is_number, value)):
            raise GtlayoutError(f"{where}, frame {name}: must be [x, y] in pixels, not {value!r}")
        lens = frame.undistort if isinstance(frame.undistort, Undistortion | Upright) else None
        image = lens or frame.camera
        width, height = image.shown_size if isinstance(image, Upright) else (image.width, image.height)
        if not (0 <= value[0] <= width and 0 <= value[1] <= height):
            raise GtlayoutError(f"{where}, frame {name}: {value} lies off its {width}x{height} px")
        marked = np.array([value], dtype=np.float64)
        if isinstance(lens, Upright):
            marked = lens.from_shown(marked)
        px = (lens.points(marked) if lens else marked)[0]
        if not np.all(np.isfinite(px)):
            raise GtlayoutError(f"{where}, frame {name}: the lens model has no inverse at {value}")
        marks.append(Mark(frame.name, frame.camera, px))
    return marks


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < math.inf
