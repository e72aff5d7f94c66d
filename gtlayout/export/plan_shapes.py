"""What a drawn floor plan is made of: areas, lines, texts and dimension lines on named layers, and how these look.

Positions are plan coordinates in world units. Plain data; ``plan_drawing`` makes it; SVG, PDF and DXF draw it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from shapely import Polygon

from gtlayout.export.helvetica import text_width
from gtlayout.scene import FloatArray

Layer = Literal[
    "floor",
    "sigma",
    "slanted",
    "open",
    "inferred",
    "walls",
    "weak_walls",
    "doors",
    "windows",
    "dimensions",
    "labels",
    "notes",
]
TEXT_MM, SMALL_TEXT_MM = 2.5, 2.0
"""Heights of capitals."""
TICK_MM = 1.0
DESCENT = 0.3
"""How far letters reach below the line, of the height of capitals."""


@dataclass(frozen=True)
class Style:
    """How a layer looks on paper."""

    color: str
    """Of lines and texts; of an area its filling."""
    width_mm: float = 0.0
    """Of its lines; areas have no outline."""
    dashes_mm: tuple[float, ...] = ()
    """Drawn and left out by turns."""


STYLES: dict[Layer, Style] = {
    "floor": Style("#f4eee6"),
    "sigma": Style("#c6dcec"),
    "slanted": Style("#7a55a0", 0.25, (2.0, 1.2)),
    "open": Style("#8a7a66", 0.25, (1.2, 1.0)),
    "inferred": Style("#2f7d4f", 0.35, (2.4, 1.2)),
    "walls": Style("#222222", 0.7),
    "weak_walls": Style("#a3a3a3", 0.7),
    "doors": Style("#b0483f", 0.25),
    "windows": Style("#2a8f86", 0.25),
    "dimensions": Style("#555555", 0.18),
    "labels": Style("#555555", 0.13),
    "notes": Style("#333333", 0.25),
}
"""In the order in which they are drawn."""


@dataclass(frozen=True)
class Area:
    """What rings bound, without outline; holes are rings within others."""

    layer: Layer
    rings: tuple[FloatArray, ...]
    """(N, 2) each, the first point not repeated."""
    name: str = ""
    """The instance it belongs to."""


@dataclass(frozen=True)
class Line:
    """A polyline."""

    layer: Layer
    points: FloatArray
    """(N, 2)."""
    name: str = ""
    """The instance it belongs to."""
    closed: bool = False


@dataclass(frozen=True)
class Text:
    """Centred about a point, or beginning there."""

    layer: Literal["dimensions", "labels", "notes"]
    text: str
    at: FloatArray
    height: float
    """Of its capitals, world unit."""
    angle_deg: float = 0.0
    centred: bool = True

    @property
    def width(self) -> float:
        """World unit."""
        return text_width(self.text, self.height)

    @property
    def start(self) -> FloatArray:
        """(2,) where its line begins."""
        along, up = directions(self.angle_deg)
        return self.at - (self.width / 2 * along + self.height / 2 * up if self.centred else 0.0)

    @property
    def box(self) -> Polygon:
        """What it covers."""
        along, up = directions(self.angle_deg)
        wide, start = self.width * along, self.start
        low, high = start - DESCENT * self.height * up, start + self.height * up
        return shapely.polygons(np.stack([low, low + wide, high + wide, high]))


@dataclass(frozen=True)
class Measure:
    """A dimension line with its text above and extension lines from the walls."""

    text: Text
    ends: FloatArray
    """(2, 2) of the dimension line."""
    origins: FloatArray
    """(2, 2) on the walls, where the extension lines begin."""
    tick: float
    """World unit."""

    @property
    def lines(self) -> list[FloatArray]:
        """The line, its ticks and its extension lines, (2, 2) each."""
        along, up = directions(self.text.angle_deg)
        slash = self.tick * (along + up)
        drawn = [self.ends, *(np.stack([end - slash, end + slash]) for end in self.ends)]
        for end, origin in zip(self.ends, self.origins, strict=True):
            way = (end - origin) / max(float(np.linalg.norm(end - origin)), 1e-300)
            drawn.append(np.stack([origin + 2 * self.tick * way, end + self.tick * way]))
        return drawn


@dataclass(frozen=True)
class Drawing:
    """A plan, drawn."""

    mm_per_unit: float
    """Millimetres of paper for a world unit."""
    areas: tuple[Area, ...]
    lines: tuple[Line, ...]
    texts: tuple[Text, ...]
    measures: tuple[Measure, ...]
    legend: tuple[Area | Line, ...]
    """Samples of the layers, beside the plan: no part of the room."""
    bounds: FloatArray
    """(2, 2) lowest and highest coordinates of it all."""


def directions(angle_deg: float) -> tuple[FloatArray, FloatArray]:
    """(2,) unit vectors: the way a text runs, and its up."""
    angle = np.deg2rad(angle_deg)
    along = np.array([np.cos(angle), np.sin(angle)])
    return along, np.array([-along[1], along[0]])


def rings(region: shapely.MultiPolygon) -> list[FloatArray]:
    """All rings of a region, (N, 2) each, the first point not repeated."""
    return [shapely.get_coordinates(ring)[:-1] for part in region.geoms for ring in (part.exterior, *part.interiors)]
