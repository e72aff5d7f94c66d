"""Reveals of synthetic rooms: doors and windows that lie behind the plane of their wall."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gtlayout.instances import PlaneFrame
from gtlayout.scene import FloatArray, Label
from gtlayout.synth.fitting import Fitter
from gtlayout.synth.surfaces import Surface, host_of
from gtlayout.synth.textures import Painter


def recess(
    structure: Sequence[Surface],
    depths_m: Mapping[Label, float],
    drawn_with_opening: bool,
    paint: Painter,
    fitter: Fitter,
) -> tuple[list[Surface], list[Surface]]:
    """The structure with its openings moved back by ``depths_m`` (by label; 0 = not) behind holes in their walls.

    Returns it in the same order, and the faces of the reveals beside it, thresholds among them. A person draws these
    as part of the opening, or of its wall.
    """
    moved, faces = list(structure), []
    for number, opening in enumerate(structure):
        depth_m, host = depths_m.get(opening.label, 0.0) if opening.label else 0.0, host_of(structure, number)
        if host is None or depth_m == 0:
            continue
        wall = moved[host]
        moved[host] = replace(wall, holes_uv=(*wall.holes_uv, wall.frame.to_plane(opening.corners_world)))
        back = PlaneFrame(opening.frame.origin - depth_m * opening.normal, opening.frame.axes)
        moved[number] = replace(opening, frame=back, part_of=wall.name)
        drawn_with = opening.name if drawn_with_opening else wall.name
        faces += [
            fitter.surface(f"{opening.name}_reveal_{side}", quad, paint, drawn_with)
            for side, quad in enumerate(_faces(opening, depth_m))
        ]
    return moved, faces


def _faces(opening: Surface, depth_m: float) -> list[FloatArray]:
    """(4, 3) per side of an opening in its wall's plane, seen from within the reveal."""
    starts = opening.corners_world
    ends, into = np.roll(starts, -1, axis=0), -depth_m * opening.normal
    return [np.stack([start, end, end + into, start + into]) for start, end in zip(starts, ends, strict=True)]
