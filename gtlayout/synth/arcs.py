"""Round walls of synthetic rooms: an arc of a circle in the floor plan, built of narrow flat facets (metres, z up)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtlayout.scene import FloatArray
from gtlayout.synth.textures import TEXEL_M, Painter, Texture

FACET_DEG = 3.0
"""A facet is so wide. Its middle is 1/3000 of the radius inside the circle: half a millimetre of 1.5 m."""


@dataclass(frozen=True)
class Arc:
    """A part of a circle in the floor plan; the room is on the side of its centre."""

    center_xy: FloatArray
    """(2,)"""
    radius_m: float
    from_rad: float
    """Where it begins, counter-clockwise from x …"""
    to_rad: float
    """… and where it ends, larger."""

    @property
    def length_m(self) -> float:
        """Along the arc."""
        return self.radius_m * (self.to_rad - self.from_rad)

    def points_xy(self) -> FloatArray:
        """(N, 2) ends of its facets, counter-clockwise."""
        count = max(2, round(np.rad2deg(self.to_rad - self.from_rad) / FACET_DEG)) + 1
        angles = np.linspace(self.from_rad, self.to_rad, count)
        return self.center_xy + self.radius_m * np.column_stack([np.cos(angles), np.sin(angles)])

    def mirrored(self) -> Arc:
        """With x → -x."""
        return replace(
            self, center_xy=self.center_xy * (-1.0, 1.0), from_rad=np.pi - self.to_rad, to_rad=np.pi - self.from_rad
        )

    def from_left_m(self, point_xy: FloatArray) -> float:
        """How far along the arc a point (2,) on it is from the left end, as one sees it from the room."""
        angle = np.arctan2(*(point_xy - self.center_xy)[::-1])
        # Seen from inside, what is counter-clockwise runs from right to left.
        return self.radius_m * float((self.to_rad - angle) % (2 * np.pi) % (2 * np.pi - 1e-9))


def strip_of(whole: Texture, left_m: float) -> Painter:
    """The painter of a facet that begins ``left_m`` from the left end of the whole wall's texture."""
    column = round(left_m / TEXEL_M)

    def paint(_: np.random.Generator, shape: tuple[int, int]) -> Texture:
        return whole[: shape[0], column : column + shape[1]]

    return paint


def whole_texture(paint: Painter, arc: Arc, height_m: float, rng: np.random.Generator) -> Texture:
    """The texture of a round wall, rolled out, a little longer than it."""
    height, length = (int(np.ceil(size / TEXEL_M)) + 4 for size in (height_m, arc.length_m))
    return paint(rng, (height, length))
