"""Widths, heights and sills of doors and windows."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import LineString, Point

from gtlayout.dimensions.facing import Taken
from gtlayout.dimensions.measurable import Measurable
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.instances import Dimension, DimensionKind
from gtlayout.scene import OPENINGS, FloatArray

_AT = np.linspace(0.3, 0.7, 5)
"""Where an opening is measured across, as shares of its other side: frames and thresholds blur its ends."""
_BORDER_PX = 4.0
"""What ends nearer than this to the border of an image of 640x480 is cut by it, or to an occlusion edge hidden."""
_NEAR_PX = 10.0
"""What ends nearer than this to where it is drawn to end, ends there: 4 σ of a drawn edge."""


def opening_dimensions(room: SolvedRoom) -> list[Taken]:
    """Width and height of every door and window whose ends are seen, and the height of each window's sill.

    An opening is measured at five places across, of which the median counts, as one measures with a tape: its corners
    are where drawings differ most. Empty when nothing tells which way is up. Those in a ceiling are left out.
    """
    up = room.up_world
    if up is None:
        return []
    found = []
    for i in room.seen:
        if room.instances[i].label in OPENINGS:
            upright = up - (up @ room.planes[i].normal) * room.planes[i].normal
            # In a ceiling nothing is upright, and no side of a window is its height.
            if np.linalg.norm(upright) > np.sin(np.deg2rad(45)):
                found += _of_opening(room, i, upright / np.linalg.norm(upright))
    return found


def _of_opening(room: SolvedRoom, index: int, up: FloatArray) -> list[Taken]:
    along = np.cross(up, room.planes[index].normal)
    across, upright = _median_chord(room, index, along, up), _median_chord(room, index, up, along)
    # Of a region in pieces the middle may be empty.
    if across is None or upright is None:
        return []
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


def _median_chord(room: SolvedRoom, index: int, along: FloatArray, across: FloatArray) -> FloatArray | None:
    """(2, 3) the ends of the chord of median length, in the direction ``along``.

    None for slivers with nothing between them, which a wrong plane leaves of a drawing.
    """
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
    if not chords:
        return None
    middle = sorted(chords, key=lambda chord: float(np.ptp(chord[:, 0])))[len(chords) // 2]
    return extent.frame.to_world(middle @ axes)


def _is_seen(room: SolvedRoom, index: int, end_world: FloatArray) -> bool:
    """Whether an opening is drawn to end there in some key frame, and not because its image does, or it is hidden."""
    for k, e in room.instances[index].members:
        camera, key_frame = room.scene.frame_of(k).camera, room.scene.key_frames[k]
        points_px, depth = camera.project(end_world[None])
        at_px, scale = Point(points_px[0]), camera.annotation_scale
        border = np.minimum(points_px[0], (camera.width, camera.height) - points_px[0]).min()
        hidden = min((LineString(line).distance(at_px) for line in key_frame.occlusion_edges), default=np.inf)
        drawn = key_frame.elements[e].amodal.boundary.distance(at_px)
        if depth[0] > 0 and min(border, hidden) > _BORDER_PX * scale and drawn < _NEAR_PX * scale:
            return True
    return False


def _length(room: SolvedRoom, index: int, ends: FloatArray) -> Measurable:
    between = ends[1] - ends[0]
    length = float(np.linalg.norm(between))
    others, across = room.on_others(index, ends), between / length
    motion = room.motion(index, ends, others)
    drawn = [
        np.hypot(room.drawn_sigma(index, end, across), _behind(room, index, end, across))
        for end, beside in zip(ends, others, strict=True)
        if not beside
    ]
    return Measurable(length, across @ (motion[1] - motion[0]), float(np.linalg.norm(drawn)))


def _behind(room: SolvedRoom, index: int, end_world: FloatArray, across: FloatArray) -> float:
    """σ of an end of an opening that lies behind its wall's plane, as it is not known what was drawn.

    People draw doors and windows with their reveals or without, and of one seen at an angle a reveal hides a part. The
    end lies between where it is on the opening's plane and on the wall's: anywhere there.
    """
    host = room.instances[index].host
    if host is None or host not in room.seen:
        return 0.0
    own, wall = room.planes[index], room.planes[host]
    behind = float(wall.normal @ end_world + wall.d)
    recess = np.sqrt(behind**2 + own.sigma_offset(end_world) ** 2 + wall.sigma_offset(end_world) ** 2)
    rays = [end_world - room.scene.frame_of(k).camera.center_world for k, _ in room.instances[index].members]
    slopes = [abs(ray @ across) / max(abs(float(ray @ own.normal)), 1e-12) for ray in rays]
    return float(recess * np.median(slopes) / np.sqrt(3))


def _sill(room: SolvedRoom, index: int, floor: int, point: FloatArray) -> Taken:
    """How high a point of an opening lies over the floor."""
    plane = room.planes[floor]
    height = float(plane.normal @ point + plane.d)
    gradient = plane.normal @ room.motion(index, point[None], [[]])[0]
    gradient[4 * floor : 4 * floor + 4] += room.moved_by(floor, point)
    ends = np.stack([point - height * plane.normal, point])
    up = plane.normal - (plane.normal @ room.planes[index].normal) * room.planes[index].normal
    up /= np.linalg.norm(up)
    drawn = np.hypot(room.drawn_sigma(index, point, up), _behind(room, index, point, up))
    measured = Measurable(height, gradient, float(drawn))
    return Dimension(floor, index, "sill", height, np.nan, ends), measured
