"""What fitters put into one room: which of the trim it gets, in which sizes, and how it is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from gtlayout.scene import FloatArray, Label
from gtlayout.synth import textures
from gtlayout.synth.baseboards import fit_baseboards
from gtlayout.synth.fitting import Fitter
from gtlayout.synth.kitchen import Run, build_run, place_run
from gtlayout.synth.reveals import recess
from gtlayout.synth.surfaces import Box, Surface
from gtlayout.synth.trim import Trim


@dataclass(frozen=True)
class Outfit:
    """The trim of one room, made with random numbers of its own: without trim a room is what it was."""

    sizes: Trim
    place_rng: np.random.Generator
    """For the kitchen's place."""
    fit_rng: np.random.Generator
    """For all that is put in."""

    @classmethod
    def of_room(cls, trim: Trim, rng: np.random.Generator) -> Outfit:
        """Draw the sizes."""
        sizes, place, fit = rng.spawn(3)
        return cls(trim.of_room(sizes), place, fit)

    def place_kitchen(self, walls: Mapping[str, FloatArray], free: shapely.Geometry) -> Run | None:
        """The place of cupboards, see ``place_run``; None when the room has none."""
        return place_run(walls, free, self.place_rng) if self.place_rng.random() < self.sizes.kitchen_share else None

    def fitted(
        self,
        structure: Sequence[Surface],
        run: Run | None,
        texture: float,
        lamps_world: FloatArray,
        boxes: Sequence[Box],
    ) -> list[Surface]:
        """The building from its painted surfaces: the same in the same order, and trim and cupboards after them."""
        fitter = Fitter(lamps_world, boxes, self.fit_rng)
        sizes, building, trim = self.sizes, list(structure), []
        paint = textures.BASEBOARD_PAINTERS[int(self.fit_rng.integers(len(textures.BASEBOARD_PAINTERS)))]
        drawn_with_opening = bool(self.fit_rng.integers(2))
        if sizes.has_baseboards:
            size_m = sizes.baseboard_height_m, sizes.baseboard_thickness_m
            gaps = {run.wall: [run.back_world]} if run is not None else {}
            trim += fit_baseboards(building, size_m, sizes.baseboard_share, gaps, paint, fitter)
        depths_m: dict[Label, float] = {"door": sizes.door_reveal_m, "window": sizes.window_reveal_m}
        building, reveals = recess(building, depths_m, drawn_with_opening, textures.REVEAL_PAINTER, fitter)
        trim += reveals
        if run is not None:
            cupboards, parts = build_run(run, sizes, texture, fitter)
            building = [_without(run, sizes, surface) for surface in building] + cupboards
            trim += parts
        return [*building, *trim]


def _without(run: Run, sizes: Trim, surface: Surface) -> Surface:
    """The main floor ends at the cupboards' foot, all else is as it was."""
    if surface.name != "floor":
        return surface
    recess_m = sizes.plinth_recess_m if sizes.has_plinth else 0.0
    return replace(surface, holes_uv=(*surface.holes_uv, surface.frame.to_plane(run.foot(recess_m))))
