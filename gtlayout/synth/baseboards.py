"""Baseboards of synthetic rooms: boxes before the foot of a wall, mitred where two meet (metres, z up)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gtlayout.scene import FloatArray
from gtlayout.synth.fitting import Fitter
from gtlayout.synth.surfaces import Surface, host_of
from gtlayout.synth.textures import Painter

_FLOOR_M = 1e-6
"""Corners up to this height stand on the floor."""
_SAME_CORNER_M = 1e-6
_LEAST_M = 0.02
"""Shorter ones are left out."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Foot:
    """A piece of the line on which a wall stands."""

    wall: int
    ends_world: FloatArray
    """(2, 3) its left and right end seen from the room."""
    normal: FloatArray
    """(3,) unit normal of the wall, level, into the room."""


def fit_baseboards(
    structure: Sequence[Surface],
    sizes_m: tuple[float, float],
    share: float,
    gaps: Mapping[str, Sequence[FloatArray]],
    paint: Painter,
    fitter: Fitter,
) -> list[Surface]:
    """Baseboards of ``sizes_m`` (height, thickness) before a share of the walls, clear of doors.

    ``gaps``: by the wall's name (2, 3) level ends of what else stands before it.
    """
    fitted = [surface.label == "wall" and fitter.rng.random() < share for surface in structure]
    feet = _feet(structure)
    board: list[Surface] = []
    for foot in feet:
        if not fitted[foot.wall]:
            continue
        wall = structure[foot.wall]
        doors = [
            opening.corners_world[opening.corners_world[:, 2] < _FLOOR_M]
            for number, opening in enumerate(structure)
            if host_of(structure, number) == foot.wall
        ]
        ends = [_end(foot, end, feet, fitted, sizes_m[1]) for end in (0, 1)]
        for back, front, caps in _pieces(foot, ends, sizes_m[1], [*doors, *gaps.get(wall.name, ())]):
            board += [
                fitter.surface(f"{wall.name}_baseboard_{len(board) + n}", quad, paint, wall.name)
                for n, quad in enumerate(_quads(back, front, caps, sizes_m[0]))
            ]
    return board


def _feet(structure: Sequence[Surface]) -> list[Foot]:
    """All edges of walls on the floor."""
    feet = []
    for number, wall in enumerate(structure):
        if wall.label == "wall" and wall.arc is None:
            corners = wall.corners_world
            for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                if max(start[2], end[2]) < _FLOOR_M:
                    feet.append(Foot(number, np.stack([start, end]), wall.normal))
    return feet


def _end(
    foot: Foot, end: int, feet: Sequence[Foot], fitted: Sequence[bool], thickness_m: float
) -> tuple[FloatArray, bool]:
    """(3,) the front's end at an end of a foot, and whether it meets the next baseboard there."""
    corner = foot.ends_world[end]
    for other in feet:
        if np.linalg.norm(other.ends_world[1 - end] - corner) < _SAME_CORNER_M:
            normals = np.stack([foot.normal[:2], other.normal[:2]])
            shift = np.linalg.solve(normals, thickness_m * np.array([1.0, float(fitted[other.wall])]))
            return corner + np.append(shift, 0.0), fitted[other.wall]
    return corner + thickness_m * foot.normal, False


def _pieces(
    foot: Foot, ends: Sequence[tuple[FloatArray, bool]], thickness_m: float, gaps: Sequence[FloatArray]
) -> list[tuple[FloatArray, FloatArray, tuple[bool, bool]]]:
    """(2, 3) back and (2, 3) front line of what is left between the gaps, and which of its two ends are open."""
    left, right = foot.ends_world
    length = float(np.linalg.norm(right - left))
    along = (right - left) / length
    taken = sorted((np.min(at), np.max(at)) for at in ((gap - left) @ along for gap in gaps if len(gap)))
    taken = [(low, high) for low, high in taken if low < length and high > 0]
    lows = [0.0, *(high for _, high in taken)]
    highs = [*(low for low, _ in taken), length]
    pieces = []
    for number, (low, high) in enumerate(zip(lows, highs, strict=True)):
        if high - low < _LEAST_M:
            continue
        back = left + np.outer((low, high), along)
        front = back + thickness_m * foot.normal
        first, last = number == 0, number == len(taken)
        front[0] = ends[0][0] if first else front[0]
        front[1] = ends[1][0] if last else front[1]
        caps = (not (first and ends[0][1]), not (last and ends[1][1]))
        pieces.append((back, front, caps))
    return pieces


def _quads(back: FloatArray, front: FloatArray, caps: tuple[bool, bool], height_m: float) -> list[FloatArray]:
    """(4, 3) front, top and open ends, counter-clockwise seen from the room, the first edge level."""
    up = height_m * _UP
    quads = [
        np.stack([front[0], front[1], front[1] + up, front[0] + up]),
        np.stack([front[0], front[1], back[1], back[0]]) + up,
    ]
    if caps[0]:
        quads.append(np.stack([back[0], front[0], front[0] + up, back[0] + up]))
    if caps[1]:
        quads.append(np.stack([front[1], back[1], back[1] + up, front[1] + up]))
    return quads
