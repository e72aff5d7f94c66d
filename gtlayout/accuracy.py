"""Levels of accuracy: how well a length or a surface is known, in the words of those who build from it. Plain data.

Reference: U.S. Institute of Building Documentation, "Level of Accuracy (LOA) Specification", version 3.0: each level is
a range of accuracy at 95 % confidence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Status = Literal["within", "out", "insufficient evidence", "inferred"]
"""Against a wanted level: as accurate, less accurate, known too little to say, or not seen itself: it closes the room
where nobody looked, or only its neighbours tell its place."""

UPPER_ENDS_M = {40: 0.005, 30: 0.015, 20: 0.05, 10: 0.15}
"""The largest error of each level at 95 %, metres, the finest level first. LOA50, below a millimetre, is not for
video."""

SIGMAS_95 = 1.959964
"""So many σ hold 95 % of a normal distribution on both sides."""


@dataclass(frozen=True)
class Accuracy:
    """How accurate something is represented, and whether that is as accurate as wanted."""

    error_95_m: float
    """It is off by at most so much with a probability of 95 %, metres; NaN where that is not known."""
    level: int
    """The finest level that it reaches: 40, 30, 20 or 10; 0 when it reaches none."""
    status: Status
    wanted: int
    """The level that it is held against."""


@dataclass(frozen=True)
class Flatness:
    """How far a surface bends, and whether DIN 18202, table 3, permits it. World unit; NaN = not known."""

    deviation: float
    """Of the surface, amid the measuring distance, from the straight line between its ends; positive where it bulges
    into the room."""
    sigma: float
    distance: float
    """The measuring distance: as far as tracks cover the surface, in the direction in which it is most certainly
    off."""
    limit_m: float
    """What is permitted over that distance, metres."""
    line: int
    """Of the table: 3 for floors, 6 for walls and ceilings; finished ones, without higher demands."""
    status: Status
    """Whether it bends less, more, or nobody can tell."""


def level_of(error_95_m: float) -> int:
    """The finest level that holds an error at 95 %, metres; 0 for none, and for NaN."""
    return next((level for level, end in UPPER_ENDS_M.items() if error_95_m <= end), 0)


def accuracy_of(sigma_m: float, wanted: int, bias_m: float = 0.0, inferred: bool = False) -> Accuracy:
    """The accuracy of what has a σ and may be off by ``bias_m`` besides, metres, against the level ``wanted``.

    What is ``inferred`` has a level, but is called neither within nor out.
    """
    error = SIGMAS_95 * sigma_m + bias_m
    level = level_of(error)
    if not math.isfinite(error):
        return Accuracy(math.nan, 0, "insufficient evidence", wanted)
    status: Status = "within" if level >= wanted else "out"
    return Accuracy(error, level, "inferred" if inferred else status, wanted)
