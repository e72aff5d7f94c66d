"""Dimension lines: beside the plan, on the side where their walls end, the shortest nearest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from gtlayout.export.floor_plan import FloorPlan, PlanDimension
from gtlayout.export.plan_labels import CLEAR_MM, upright
from gtlayout.export.plan_shapes import TEXT_MM, TICK_MM, Measure, Text, directions
from gtlayout.figures import is_known, with_sigma
from gtlayout.scene import FloatArray

FIRST_MM, NEXT_MM = 6.5, 7.0
"""Distances of dimension lines: from everything, and from one another."""
ABOVE_MM = 1.2
"""From a dimension line to its text."""
MOST = 4
"""Dimension lines on each side; those that are known worst stand in the notes."""
ROWS = 40
"""Places that are tried, further and further out."""
_SAME = 1e-6


@dataclass(frozen=True)
class Side:
    """The side of the plan on which the dimension line of two walls stands."""

    dimension: PlanDimension
    outward: FloatArray
    """(2,) unit vector, at right angles to what is measured."""
    origins: FloatArray
    """(2, 2) the ends of both walls on that side."""

    @property
    def key(self) -> tuple[int, int]:
        """The axis that it moves out along, and which way."""
        axis = int(abs(self.outward[1]) >= abs(self.outward[0]))
        return axis, int(np.sign(self.outward[axis]))


def length_text(length: float, sigma: float, metric: bool) -> str:
    """``3.94 ± 0.02 m``: two digits of σ, no finer than millimetres. The one place that says what ± is in a plan."""
    known = is_known(sigma, length) and sigma > 0
    digits = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 3 if metric else 9)) if known else 3
    return with_sigma(length, sigma, digits, " m" if metric else " units")


MEANING = "± is one standard deviation. Lengths without ± are as drawn."
"""What ± is in ``length_text``, in words."""


def sides(plan: FloorPlan) -> tuple[list[Side], list[PlanDimension]]:
    """Which widths have a dimension line, and where; and those that have none, with the heights."""
    ends_of = {wall.name: wall.ends for wall in plan.walls}
    found: list[Side] = []
    others: list[PlanDimension] = []
    for one in sorted(plan.dimensions, key=lambda one: (not np.isfinite(one.sigma), one.sigma)):
        if one.kind != "width" or not ends_of.keys() >= set(one.names):
            others.append(one)
            continue
        side = _side(one, [ends_of[name] for name in one.names], plan.bounds)
        if sum(other.key == side.key for other in found) < MOST:
            found.append(side)
        else:
            others.append(one)
    return sorted(found, key=lambda side: side.dimension.length), others


def _side(one: PlanDimension, walls: Sequence[FloatArray], bounds: FloatArray) -> Side:
    """The side to which the extension lines are shorter; if they are the same, below or to the left."""
    across = (one.ends[1] - one.ends[0]) / max(float(np.linalg.norm(one.ends[1] - one.ends[0])), 1e-300)
    outward = np.array([-across[1], across[0]])
    axis = int(abs(outward[1]) >= abs(outward[0]))
    outward = outward if outward[axis] < 0 else -outward
    options = []
    for way in (outward, -outward):
        origins = np.stack([max(ends, key=lambda end: float(end @ way)) for ends in walls])
        options.append((float(2 * _reach(bounds, way) - (origins @ way).sum()), Side(one, way, origins)))
    (below, first), (above, second) = options
    return second if above < below - _SAME * float(np.abs(bounds).max()) else first


def extensions(found: Sequence[Side], bounds: FloatArray) -> list[BaseGeometry]:
    """The lines along which the extension lines will run, long enough for any place of the dimension line."""
    reach = 3.0 * float(np.linalg.norm(np.ptp(bounds, axis=0)))
    return [LineString([start, start + reach * side.outward]) for side in found for start in side.origins]


def measures(
    found: Sequence[Side], bounds: FloatArray, metric: bool, mm: float
) -> tuple[list[Measure], list[BaseGeometry]]:
    """The dimension lines, beyond all that lies within ``bounds``; and what they cover, texts included."""
    drawn: list[Measure] = []
    covered: list[BaseGeometry] = []
    for side in found:
        ends = side.dimension.ends
        out = _reach(bounds, side.outward) - float(ends.mean(axis=0) @ side.outward) + FIRST_MM * mm
        for _ in range(ROWS):
            measure = _measure(side, ends + out * side.outward, metric, mm)
            own = [measure.text.box, LineString(measure.ends)]
            if not any(one.dwithin(other, CLEAR_MM * mm) for one in own for other in covered):
                break
            out += NEXT_MM * mm
        drawn.append(measure)
        covered += own
    return drawn, covered


def _measure(side: Side, ends: FloatArray, metric: bool, mm: float) -> Measure:
    one = side.dimension
    along = ends[1] - ends[0]
    angle = upright(float(np.rad2deg(np.arctan2(along[1], along[0]))))
    _, up = directions(angle)
    at = ends.mean(axis=0) + (ABOVE_MM + TEXT_MM / 2) * mm * up
    text = Text("dimensions", length_text(one.length, one.sigma, metric), at, TEXT_MM * mm, angle)
    return Measure(text, ends, side.origins, TICK_MM * mm)


def _reach(bounds: FloatArray, way: FloatArray) -> float:
    """How far a box, its lowest and highest coordinates, reaches in a direction."""
    return float(np.maximum(bounds[0] * way, bounds[1] * way).sum())
