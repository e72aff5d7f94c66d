"""What DIN 18202 permits surfaces to be off by, and how what was measured stands against it.

Reference: DIN 18202, "Toleranzen im Hochbau – Bauwerke" (tolerances in building construction), table 3: the largest
deviation of a surface from the straight line between two of its points, by their distance; between the columns values
are interpolated and rounded to millimetres.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from gtlayout.accuracy import SIGMAS_95, Flatness, Status
from gtlayout.flatness.bends import Bend
from gtlayout.instances import Instance
from gtlayout.scene import Label

DISTANCES_M = (0.1, 1.0, 4.0, 10.0, 15.0)
LIMITS_MM = {
    3: (2, 4, 10, 12, 15),
    5: (5, 10, 15, 25, 30),
    6: (3, 5, 10, 20, 25),
    7: (2, 3, 8, 15, 20),
}
"""By line of the table: 3 finished floors; 5 unfinished walls and undersides of slabs; 6 finished walls and ceilings; 7
the same with higher demands."""
_LINES: dict[Label, int] = {"floor": 3}
_OTHER_LINE = 6
_SIGMAS_OUT = 3.0
"""A surface is out when it is off by more than is permitted and so many σ, in any of four directions. With normal
errors that would be wrong once in a hundred surfaces."""


def limit_m(line: int, distance_m: float) -> float:
    """The largest deviation that a line of the table permits over a measuring distance."""
    return round(float(np.interp(distance_m, DISTANCES_M, LIMITS_MM[line]))) / 1000


def flatness_of(
    instances: Sequence[Instance], bends: Sequence[Sequence[Bend]], metric: bool, curved: Collection[int] = ()
) -> tuple[Flatness | None, ...]:
    """Of each instance how flat it is; None for doors, windows and ``curved`` walls, of which nothing is asked.

    Each is given in the direction in which it is most certainly off, as a share of what is permitted. It is *out* when
    it is off by more than is permitted and 3 σ in any direction; *within* when it is not, by 1.96 σ, in any; else the
    evidence is insufficient, as it is in a scene without a unit.
    """
    return tuple(
        None if one.host is not None or i in curved else _flatness(of_one, _LINES.get(one.label, _OTHER_LINE), metric)
        for i, (one, of_one) in enumerate(zip(instances, bends, strict=True))
    )


def _flatness(bends: Sequence[Bend], line: int, metric: bool) -> Flatness:
    if not bends:
        return Flatness(np.nan, np.nan, np.nan, np.nan, line, "insufficient evidence")
    deviation, sigma, distance = np.array([[one.deviation, one.sigma, one.distance] for one in bends]).T
    limits = np.array([limit_m(line, each) for each in distance]) if metric else distance
    least = (np.abs(deviation) - _SIGMAS_OUT * sigma) / limits
    worst = int(np.argmax(least))
    status: Status = "insufficient evidence"
    if metric and least.max() > 1:
        status = "out"
    elif metric and np.max((np.abs(deviation) + SIGMAS_95 * sigma) / limits) <= 1:
        status = "within"
    limit = float(limits[worst]) if metric else np.nan
    return Flatness(bends[worst].deviation, bends[worst].sigma, bends[worst].distance, limit, line, status)
