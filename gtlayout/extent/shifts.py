"""Where an extent ends whose drawn line lies beside that in which two planes meet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtlayout.edges import ContactEdge
from gtlayout.extent.refine import meeting_line
from gtlayout.instances import ContactOffsets, Plane, PlaneFrame
from gtlayout.scene import FloatArray, Scene

_WIDEST = 3.0
"""Seen at a grazing angle, a line before the plane falls far behind itself: by so many of its heights at most."""


def shifts_on_planes(
    scene: Scene,
    planes: Sequence[Plane],
    frames: Sequence[PlaneFrame],
    edges: Sequence[ContactEdge],
    offsets: ContactOffsets,
) -> dict[tuple[int, int], float]:
    """For each ordered pair (i, j) in contact how far from its line with plane j the drawn line is seen on plane i.

    World unit, positive in front of plane j; the median over the key frames that show the contact. There a baseboard's
    foot hides where floor and wall meet: the floor ends before that line, the wall as far below the floor as is hidden.
    """
    shifts = {}
    for pair, offset in offsets.items():
        centers = np.array(
            [scene.frame_of(edge.key_frame).camera.center_world for edge in edges if set(edge.instances) == set(pair)]
        )
        for i, j in (pair, pair[::-1]):
            line, _ = meeting_line(planes[j], frames[i])
            shifts[i, j] = float(np.median(_seen_on(planes[i], frames[i], line, offset, centers)))
    return shifts


def _seen_on(plane: Plane, frame: PlaneFrame, line: FloatArray, offset: FloatArray, centers: FloatArray) -> FloatArray:
    """(K,) distance from ``line`` at which (K, 3) cameras see, on the plane, that line moved by (3,) ``offset``."""
    beside, height = line[:2] @ (frame.axes @ offset), plane.normal @ offset
    distance = frame.to_plane(centers) @ line[:2] + line[2]
    clearance = centers @ plane.normal + plane.d - height
    slope = np.clip((beside - distance) / np.where(np.abs(clearance) < 1e-12, 1e-12, clearance), -_WIDEST, _WIDEST)
    return beside + height * slope
