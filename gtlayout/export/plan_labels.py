"""Where the names stand in a floor plan: outside their wall, off walls, swinging doors and one another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.export.floor_plan import FloorPlan, Footprint
from gtlayout.scene import OPENINGS, FloatArray

TEXT_MM = 2.5
SMALL_TEXT_MM = 2.0
CHARACTER = 0.62
"""Mean width of a character of a sans-serif face, of its height."""
ROWS_MM = (2.0, 6.5)
"""Distances from the wall."""
PLACES = (0.5, 0.25, 0.75)
"""Along it."""
UPRIGHT_DEG = 75.0
"""Texts fall to the right by no more than this."""


@dataclass(frozen=True)
class Text:
    """Centred about a point, or beginning there."""

    layer: Literal["labels", "notes"]
    text: str
    at: FloatArray
    height: float
    """Of its capitals, world unit."""
    angle_deg: float = 0.0
    centred: bool = True

    @property
    def box(self) -> Polygon:
        """About what it covers."""
        width, height = CHARACTER * len(self.text) * self.height, self.height
        corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
        corners -= [width / 2, height / 2] if self.centred else [0.0, 0.0]
        angle = np.deg2rad(self.angle_deg)
        return Polygon(self.at + corners @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def upright(angle_deg: float) -> float:
    """The same direction or the opposite one: so that a text reads from below or from the right."""
    return (angle_deg + UPRIGHT_DEG) % 180.0 - UPRIGHT_DEG


def labels(plan: FloorPlan, mm: float) -> list[Text]:
    """Names and lengths of doors and windows, then of walls, the longest first; ``mm`` of paper in world units.

    Where there is no room for a length there is none; where there is none for the name, it overlaps something.
    """
    taken: list[BaseGeometry] = [shapely.LineString(one.ends) for one in (*plan.walls, *plan.openings)]
    taken += [_swing(one) for one in plan.openings if one.label == "door"]
    texts = []
    for one in sorted((*plan.openings, *plan.walls), key=lambda one: (one.label not in OPENINGS, -one.length)):
        candidates = list(_candidates(one, plan.metric, mm))
        text = next((t for t in candidates if not shapely.intersects(t.box, taken).any()), candidates[-1])
        taken.append(text.box)
        texts.append(text)
    return texts


def _candidates(one: Footprint, metric: bool, mm: float) -> Iterator[Text]:
    """The best first; the last one is what remains when all are taken."""
    height = (SMALL_TEXT_MM if one.label in OPENINGS else TEXT_MM) * mm
    along = one.ends[1] - one.ends[0]
    angle = upright(float(np.rad2deg(np.arctan2(along[1], along[0]))))

    def text(words: str, place: float, row_mm: float, side: float) -> Text:
        at = one.ends[0] + place * along + side * (row_mm * mm + height / 2) * one.inside
        return Text("labels", words, at, height, angle)

    with_length = f"{one.name} {one.length:.2f}{' m' if metric else ''}"
    for words in (with_length, one.name):
        if words == one.name or CHARACTER * len(words) * height <= one.length:
            for side in (-1.0, 1.0):
                for place in PLACES:
                    yield from (text(words, place, row_mm, side) for row_mm in ROWS_MM)
    yield text(one.name, PLACES[0], ROWS_MM[0], -1.0)


def _swing(door: Footprint) -> Polygon:
    return Polygon([*door.ends, *(door.ends[::-1] + door.length * door.inside)])
