"""Geometry of Label Studio's regions: polygons, vectors, brush masks, rectangles.

Coordinates are percent of the image's width and height, (0, 0) its top-left corner, (100, 100) its bottom-right one:
``x / 100 * width`` is how ``label_studio_sdk.converter`` makes pixels of them. They belong to the image as it is
stored: ``image_rotation`` only turns the view (``Image.rotate`` of the editor leaves regions alone).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection
from typing import Any

import numpy as np

from gtlayout.io.annotations.checked import MAX_PX, UnusableError, is_px
from gtlayout.io.annotations.label_studio.brush import BrokenMaskError, decode_mask
from gtlayout.io.annotations.masks import mask_polygons, simple_rings
from gtlayout.scene import FloatArray

NO_POINT = "a point is not [x, y] in percent"


HOLDS = {
    "polygon": {"points"},
    "vector": {"vertices"},
    "brush": {"rle"},
    "magicwand": {"rle"},
    "rectangle": {"x", "y", "width", "height"},
}
"""Kinds of regions that are read, as ``type`` calls them without ``labels`` behind → what their value holds."""


def region_geometry(
    value: dict[str, Any], size: tuple[int, int]
) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """``value`` of a result, drawn on ``size`` (width, height) px → its polygons and lines, percent.

    Raises UnusableError.
    """
    if "points" in value:
        return (_points(value["points"]),), ()
    if "vertices" in value:
        return _vector(value["vertices"], closed=value.get("closed") is True)
    if "rle" in value:
        return _brush(value["rle"], size), ()
    return (_rectangle(value, size),), ()


def is_drawn(value: dict[str, Any], kinds: Collection[str]) -> bool:
    """Whether it holds geometry of a kind that is read, and of one of ``kinds`` where there are any."""
    return any(HOLDS[kind] <= value.keys() for kind in kinds or HOLDS)


def is_curved(value: dict[str, Any]) -> bool:
    """Whether it is a vector with Bézier points; they are read as straight."""
    vertices = value.get("vertices")
    return isinstance(vertices, list) and any(isinstance(v, dict) and v.get("isBezier") is True for v in vertices)


def _points(value: Any) -> FloatArray:
    if not isinstance(value, list) or not value:
        raise UnusableError("it has no points")
    if set(map(type, value)) != {list} or set(map(len, value)) != {2}:
        raise UnusableError(NO_POINT)
    if not {type(number) for point in value for number in point} <= {int, float}:
        raise UnusableError(NO_POINT)
    try:
        points = np.array(value, dtype=np.float64)
    except OverflowError as error:
        raise UnusableError(NO_POINT) from error
    if not np.all(np.abs(points) <= MAX_PX):
        raise UnusableError(NO_POINT)
    return points


def _vector(value: Any, *, closed: bool) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """Vertices follow the one they name, which need not be the one before them (skeletons, vertices put in later)."""
    if not isinstance(value, list) or not all(isinstance(vertex, dict) for vertex in value):
        raise UnusableError("its vertices are no list of objects")
    points = _points([[vertex.get("x"), vertex.get("y")] for vertex in value])
    index = {vertex["id"]: i for i, vertex in enumerate(value) if isinstance(vertex.get("id"), str)}
    linked = any(isinstance(vertex.get("prevPointId"), str) for vertex in value)
    after: defaultdict[int, list[int]] = defaultdict(list)
    begins: list[int] = []
    for i, vertex in enumerate(value):
        previous = vertex.get("prevPointId")
        before = (index.get(previous) if isinstance(previous, str) else None) if linked else i - 1
        (begins if before is None or before < 0 else after[before]).append(i)
    open_ends = [[i] for i in begins] or [[0]]
    seen = {path[0] for path in open_ends}
    paths: list[list[int]] = []
    while open_ends:
        path = open_ends.pop()
        while following := [i for i in after[path[-1]] if i not in seen]:
            seen.update(following)
            open_ends += [[path[-1], i] for i in following[1:]]
            path.append(following[0])
        paths.append(path)
    if closed:
        whole = len(paths) == 1 and sorted(paths[0]) == list(range(len(points)))
        return (points[paths[0]] if whole else points,), ()
    return (), tuple(points[path] for path in paths)


def _brush(value: Any, size: tuple[int, int]) -> tuple[FloatArray, ...]:
    try:
        mask = decode_mask(bytes(value if isinstance(value, list) else ()), size)
    except BrokenMaskError as error:
        raise UnusableError(str(error)) from error
    except (ValueError, TypeError) as error:
        raise UnusableError("its mask is no list of bytes") from error
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        raise UnusableError("its mask is empty")
    corner = np.array([columns[0], rows[0]])
    painted = mask_polygons(mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1])
    return tuple((ring + corner) / size * 100 for ring in simple_rings(painted))


def _rectangle(value: dict[str, Any], size: tuple[int, int]) -> FloatArray:
    """Turned about its first corner, clockwise, in pixels (``convert_annotation_to_yolo_obb`` of the SDK)."""
    numbers = [value["x"], value["y"], value["width"], value["height"], value.get("rotation") or 0]
    if not all(map(is_px, numbers)):
        raise UnusableError("x, y, width, height or rotation is no number")
    corner, sides = np.array(numbers[:2]) * size / 100, np.array(numbers[2:4]) * size / 100
    cos, sin = math.cos(math.radians(numbers[4])), math.sin(math.radians(numbers[4]))
    across, down = sides[0] * np.array([cos, sin]), sides[1] * np.array([-sin, cos])
    corners = np.stack([corner, corner + across, corner + across + down, corner + down])
    return np.asarray(corners / size * 100, dtype=np.float64)
