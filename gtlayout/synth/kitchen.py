"""Kitchens of synthetic rooms: cupboards along a wall, on a plinth and below a worktop (metres, z up).

Front and ends of the cupboards are structure, and drawn as annotators do: as walls, down to the plinth's foot and up to
the worktop. The worktop is drawn as part of the wall behind it, down to its lower edge.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from gtlayout.scene import FloatArray
from gtlayout.synth import textures
from gtlayout.synth.fitting import Fitter
from gtlayout.synth.surfaces import Surface
from gtlayout.synth.textures import faded
from gtlayout.synth.trim import Trim

DEPTH_M, HEIGHT_M, WORKTOP_M = 0.6, 0.86, 0.04
"""Of the cupboards without plinth and worktop, and the thickness of the worktop: lower than any window sill."""
LENGTH_M = (1.6, 2.6)
"""Least and greatest length."""
_TRIES = 200
"""After so many places that do not fit there is no kitchen."""
_MARGIN_M = 0.06
"""Free place about the cupboards, wider than worktops reach beyond them."""
_TOUCH_M = 1e-6
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Run:
    """The place of a row of cupboards."""

    wall: str
    """Name of the wall behind."""
    back_world: FloatArray
    """(2, 3) the left and right end of its foot on the wall, seen from the room."""

    @property
    def along(self) -> FloatArray:
        """(3,) unit vector from left to right."""
        span = self.back_world[1] - self.back_world[0]
        return span / np.linalg.norm(span)

    @property
    def normal(self) -> FloatArray:
        """(3,) unit normal of the front, into the room."""
        return np.cross(self.along, _UP)

    def foot(self, inset_m: float = 0.0) -> FloatArray:
        """(4, 3) outline on the floor, front and ends moved inwards: back left, front left, front right, back right."""
        left, right = self.back_world + inset_m * np.outer((1, -1), self.along)
        out = (DEPTH_M - inset_m) * self.normal
        return np.stack([left, left + out, right + out, right])

    @property
    def place(self) -> Polygon:
        """x, y of what cupboards and worktop cover."""
        return Polygon(self.foot(-_MARGIN_M)[:, :2])


def place_run(walls: Mapping[str, FloatArray], free: shapely.Geometry, rng: np.random.Generator) -> Run | None:
    """Where cupboards find place within ``free`` (x, y), None when nowhere.

    ``walls``: (2, 3) left and right end of the foot of each wall that may have them.
    """
    names = list(walls)
    spans = np.array([ends[1] - ends[0] for ends in walls.values()])
    lengths_m = np.linalg.norm(spans, axis=1)
    for _ in range(_TRIES):
        number = int(rng.choice(len(names), p=lengths_m / lengths_m.sum()))
        length_m, share = rng.uniform(*LENGTH_M), rng.random()
        if length_m > lengths_m[number]:
            continue
        along = spans[number] / lengths_m[number]
        low_m = share * (lengths_m[number] - length_m)
        left = walls[names[number]][0] + low_m * along
        run = Run(names[number], np.stack([left, left + length_m * along]))
        if free.covers(run.place.buffer(-_TOUCH_M)):
            return run
    return None


def build_run(run: Run, trim: Trim, texture: float, fitter: Fitter) -> tuple[list[Surface], list[Surface]]:
    """Front, left and right end of the cupboards, which are structure, and plinth and worktop, which are trim.

    ``texture`` as in ``make_room``.
    """
    plinth_m = trim.plinth_height_m if trim.has_plinth else 0.0
    wood = faded(textures.CABINET_PAINTER, texture)
    names = ("left", "front", "right")
    structure = [
        fitter.surface(f"wall_cupboard_{name}", quad, wood, None, "wall")
        for name, quad in zip(names, _sides(run.foot(), plinth_m, HEIGHT_M), strict=True)
    ]
    trims = []
    if plinth_m:
        foot = run.foot(trim.plinth_recess_m)
        trims += [
            fitter.surface(f"plinth_{name}", quad, textures.PLINTH_PAINTER, f"wall_cupboard_{name}")
            for name, quad in zip(names, _sides(foot, 0.0, plinth_m), strict=True)
        ]
    top = run.foot(-trim.worktop_overhang_m)
    rims = _sides(top, HEIGHT_M, HEIGHT_M + WORKTOP_M)
    lid, bottom = top[[1, 2, 3, 0]] + (HEIGHT_M + WORKTOP_M) * _UP, top[[0, 3, 2, 1]] + HEIGHT_M * _UP
    trims += [
        fitter.surface(f"worktop_{number}", quad, textures.WORKTOP_PAINTER, run.wall)
        for number, quad in enumerate([*rims, lid, bottom])
    ]
    return structure, trims


def _sides(outline: FloatArray, low_m: float, high_m: float) -> list[FloatArray]:
    """(4, 3) left, front and right side of a box before a wall, counter-clockwise seen from the room."""
    low, high = outline + low_m * _UP, outline + high_m * _UP
    return [np.stack([low[n], low[n + 1], high[n + 1], high[n]]) for n in range(3)]
