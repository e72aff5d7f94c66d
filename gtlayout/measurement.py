"""What people measured in a room by hand: with a tape, a laser or a set square. Plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

TAPE_SIGMA_M = 0.003
"""σ of a length measured with a tape or a laser."""
GROSS_M = 0.05
"""A slip of a reading that a measurement should not be able to hide: a line of the tape misread."""
SURE = 2.576
"""A measurement that lies further from its prediction, in σ of both, contradicts it. One of 100 right ones does."""
NAMED = SURE + 1.645
"""A slip of so many σ is named in 95 of 100 cases."""
PULL = 0.65
"""A measurement moves what predicts it by so many σ at most: less than one, as it also changes what others count as."""


def held_back_by(deviations: npt.NDArray[np.float64], sigma: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Variance to add to measurements so many σ from their prediction, so that they move it by ``PULL`` σ at most."""
    return np.asarray(sigma**2 * np.maximum(deviations / PULL - 1, 0.0))


MeasuredKind = Literal["between", "width", "height", "sill", "angle", "points"]
MEASURED_AS: dict[str, MeasuredKind] = {
    "height": "between",
    "width": "between",
    "opening width": "width",
    "opening height": "height",
    "sill": "sill",
}
"""By which kind of measurement each kind of dimension is measured."""
MarkedPoint = tuple[tuple[str, tuple[float, float]], ...]
"""Names of frames, and the pixel of the point in their pinhole image."""


@dataclass(frozen=True)
class ElementName:
    """An element as people know it."""

    image: str
    """File name of the key frame's image."""
    element: str
    """The annotator's id in that key frame."""


@dataclass(frozen=True)
class Measurement:
    """A length or an angle of one or two instances, or the distance of two points."""

    kind: MeasuredKind
    """The distance between two that face each other; the width, height or sill of a door or window; the angle that the
    normals of two make; the distance of two points that are marked in images."""
    instances: tuple[str, ...]
    """Names in the solved layout: two of a distance or angle, none of points, else one."""
    value: float
    """Metres; degrees of an angle."""
    sigma: float
    """Its σ, in the same unit."""
    elements: tuple[ElementName | None, ...] = ()
    """An element of each instance, by which it is found when instances are numbered anew; None = by its name."""
    points: tuple[MarkedPoint, ...] = ()
    """Two, of a distance of points."""
    assumed: bool = False
    """Taken for granted and not measured: the height of a door leaf."""

    @property
    def name(self) -> str:
        """``floor_0 – ceiling_0``, ``width of door_0``."""
        if self.kind == "points":
            return f"two points in {self.points[0][0][0]}" if self.points else "two points"
        if self.kind in ("between", "angle"):
            of = " – ".join(self.instances)
            return of if self.kind == "between" else f"angle {of}"
        return f"{self.kind} of {self.instances[0]}"

    @property
    def unit(self) -> str:
        """Of value and σ."""
        return "°" if self.kind == "angle" else "m"


@dataclass(frozen=True)
class Checked:
    """A measurement beside what the video and the other measurements say."""

    measurement: Measurement
    predicted: float
    """Without this measurement, in its unit; in a scene whose unit only this one knows, NaN."""
    predicted_sigma: float
    used: bool
    """False when it contradicts them."""

    @property
    def deviations(self) -> float:
        """How far it lies from the prediction, in σ of both together; NaN when nothing else predicts it."""
        return abs(self.measurement.value - self.predicted) / self._both

    @property
    def hidden_slip(self) -> float:
        """A slip of its reading that is named in 95 of 100 cases: smaller ones may hide. NaN when nothing predicts."""
        return NAMED * self._both

    @property
    def counted_sigma(self) -> float:
        """The σ with which it counts: larger than its own where it would move all else by more than ``PULL`` σ."""
        added = float(held_back_by(np.array(self.deviations), np.array(self._both)))
        return float(np.hypot(self.measurement.sigma, added**0.5)) if np.isfinite(added) else self.measurement.sigma

    @property
    def held_back(self) -> bool:
        """Whether it is used, but counts less than its σ says."""
        return self.used and self.deviations > PULL

    @property
    def _both(self) -> float:
        """σ of the difference of measurement and prediction."""
        return float(np.hypot(self.predicted_sigma, self.measurement.sigma))


@dataclass(frozen=True)
class Scale:
    """Metres in a unit of the given cameras, as measurements tell."""

    factor: float
    sigma_share: float
    """σ of the factor, as a share of it."""
    gave_unit: bool = False
    """Whether the scene had no unit without it. Its depth maps and true planes are in the units of its files."""
