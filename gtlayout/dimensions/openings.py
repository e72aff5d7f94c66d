"""Widths, heights and sills of doors and windows."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import LineString

from gtlayout.dimensions.facing import Taken
from gtlayout.dimensions.measurable import Measurable
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.instances import Dimension, DimensionKind
from gtlayout.scene import OPENINGS, FloatArray

_AT = np.linspace(0.3, 0.7, 5)
"""Where an opening is measured across, as shares of its other side: frames and thresholds blur its ends."""
_BORDER_PX = 4.0
"""What ends nearer to the border of an image of 640x480 is cut by it."""


def opening_dimensions(room: SolvedRoom) -> list[Taken]:
    """Width and height of every door and window whose ends are seen, and the height of each window's sill.

    An opening is measured at five places across, of which the median counts, as one measures with a tape: its corners
    are where drawings differ most. Empty when nothing tells which way is up.
    """
    up = room.up_world
    if up is None:
        return []
    found = []
    for i in room.seen:
        if room.instances[i].label in OPENINGS:
            upright = up - (up @ room.planes[i].normal) * room.planes[i].normal
            # In a ceiling there is no height; its own axes are as good as any.
            axis = upright if np.linalg.norm(upright) > np.sin(np.deg2rad(45)) else room.extents[i].frame.axes[1]
            found += _of_opening(room, i, axis / np.linalg.norm(axis))
    return found


def _of_opening(room: SolvedRoom, index: int, up: FloatArray) -> list[Taken]:
    along = np.cross(up, room.planes[index].normal)
    across, upright = _median_chord(room, index, along, up), _median_chord(room, index, up, along)
    kinds: tuple[tuple[DimensionKind, FloatArray], ...] = (("opening width", across), ("opening height", upright))
    found = []
    for kind, ends in kinds:
        if not all(_is_seen(room, index, end) for end in ends):
            continue
        measured = _length(room, index, ends)
        found.append((Dimension(index, index, kind, measured.value, np.nan, ends), measured))
    floors = [i for i in room.seen if room.instances[i].label == "floor"]
    if room.instances[index].label == "window" and floors:
        floor = max(floors, key=lambda i: room.extents[i].region.area)
        sill = _sill(room, index, floor, upright[0])
        found += [sill] if sill[1].value > 0 else []
    return found


def _median_chord(room: SolvedRoom, index: int, along: FloatArray, across: FloatArray) -> FloatArray:
    """(2, 3) the ends of the chord of median length, in the direction ``along``."""
    extent = room.extents[index]
    axes = np.stack([extent.frame.axes @ along, extent.frame.axes @ across])
    region = shapely.transform(extent.region, lambda uv: uv @ axes.T)
    low, high = np.reshape(region.bounds, (2, 2))
    chords = []
    for at in low[1] + _AT * (high[1] - low[1]):
        line = region.intersection(LineString([(low[0] - 1, at), (high[0] + 1, at)]))
        if not line.is_empty:
            left, _, right, _ = line.bounds
            chords.append(np.array([[left, at], [right, at]]))
    middle = sorted(chords, key=lambda chord: float(np.ptp(chord[:, 0])))[len(chords) // 2]
    return extent.frame.to_world(middle @ axes)


def _is_seen(room: SolvedRoom, index: int, end_world: FloatArray) -> bool:
    """Whether some key frame shows where an opening ends, and not only where its image does."""
    for k, _ in room.instances[index].members:
        camera = room.scene.frame_of(k).camera
        points_px, depth = camera.project(end_world[None])
        inside = np.minimum(points_px[0], (camera.width, camera.height) - points_px[0])
        if depth[0] > 0 and inside.min() > _BORDER_PX * camera.annotation_scale:
            return True
    return False


def _length(room: SolvedRoom, index: int, ends: FloatArray) -> Measurable:
    between = ends[1] - ends[0]
    length = float(np.linalg.norm(between))
    others = room.on_others(index, ends)
    motion = room.motion(index, ends, others)
    free = [room.drawn_sigma(index, end) for end, beside in zip(ends, others, strict=True) if not beside]
    return Measurable(length, between / length @ (motion[1] - motion[0]), float(np.linalg.norm(free)))


def _sill(room: SolvedRoom, index: int, floor: int, point: FloatArray) -> Taken:
    """How high a point of an opening lies over the floor."""
    plane = room.planes[floor]
    height = float(plane.normal @ point + plane.d)
    gradient = plane.normal @ room.motion(index, point[None], [[]])[0]
    gradient[4 * floor : 4 * floor + 4] += room.moved_by(floor, point)
    ends = np.stack([point - height * plane.normal, point])
    measured = Measurable(height, gradient, room.drawn_sigma(index, point))
    return Dimension(floor, index, "sill", height, np.nan, ends), measured
