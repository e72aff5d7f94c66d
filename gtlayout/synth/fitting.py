"""Makes the surfaces of trim and cupboards: painted and lit like the room they are put into."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtlayout.scene import FloatArray, Label
from gtlayout.synth.surfaces import Box, Surface, lamp_light, make_surface
from gtlayout.synth.textures import Painter


@dataclass(frozen=True)
class Fitter:
    """Makes surfaces under the nearest lamp of a room, from a generator that nothing else uses."""

    lamps_world: FloatArray
    """(rooms, 3)"""
    boxes: Sequence[Box]
    """The furniture, which darkens what is near."""
    rng: np.random.Generator

    def surface(
        self, name: str, corners_world: FloatArray, paint: Painter, part_of: str | None, label: Label | None = None
    ) -> Surface:
        """A surface of (N, 3) corners, see ``make_surface``; ``part_of`` as in ``Surface``."""
        centre = corners_world.mean(axis=0)
        lamp = self.lamps_world[np.argmin(np.linalg.norm(self.lamps_world - centre, axis=1))]
        made = make_surface(name, label, corners_world, paint, lamp_light(lamp, self.boxes), self.rng)
        return replace(made, part_of=part_of)
