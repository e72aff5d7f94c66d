"""The metric scale from one measured distance: two points of the room, marked in several frames."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.marked_points import triangulated
from gtlayout.importing.metric_scale import Scale
from gtlayout.io.files import read_json
from gtlayout.io.image_names import NameIndex
from gtlayout.io.marked_points import FORM, marks_of
from gtlayout.scene import Scene

MAX_SIGMA_SHARE = 0.1
"""A scale with a larger σ does not make a scene metric."""
MAX_METRES = 1000.0


def scale_from_distance(scene: Scene, path: Path) -> Scale:
    """The scale at which two points are as far apart as the file ``path`` says.

    The file is ``{"metres": 2.03, "points": [{"a.jpg": [x, y], "b.jpg": [x, y]}, {…}]}``: per point its pixels in two
    or more frames, in the image as a viewer shows it, (0, 0) the top-left corner of the top-left pixel. σ follows
    from marks good to 1 px. Raises GtlayoutError naming file, point and frame when the content is not valid, the
    frames see a point from nearly the same place, the marks of a point disagree, or the scale would be known to less
    than 10 %.
    """
    data = read_json(path)
    metres, points = data.get("metres"), data.get("points")
    if not isinstance(metres, int | float) or isinstance(metres, bool) or not 0 < metres <= MAX_METRES:
        raise GtlayoutError(f"{path}: metres must be a positive number up to {MAX_METRES:.0f}, not {metres!r}")
    if not isinstance(points, list) or len(points) != 2:
        raise GtlayoutError(f"{path}: points must be a list of two: {FORM}")
    names = NameIndex([frame.name for frame in scene.frames])
    (first, cov_first), (second, cov_second) = (
        triangulated(marks_of(point, scene.frames, names, f"{path}, point {i}"), f"{path}, point {i}")
        for i, point in enumerate(points, start=1)
    )
    between = second - first
    distance = float(np.linalg.norm(between))
    sigma = math.sqrt(float(between @ (cov_first + cov_second) @ between)) / distance if distance > 0 else math.inf
    if sigma > MAX_SIGMA_SHARE * distance:
        raise GtlayoutError(
            f"{path}: the points' distance is {distance:.3g} ± {sigma:.3g} units of the scene, too uncertain; "
            "take points further apart, and mark them in frames from more different places"
        )
    return Scale(metres / distance, sigma / distance, f"a known distance of {metres:g} m")
