"""A length, area or volume as a function of all planes, to first order."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtlayout.instances import propagated_sigma
from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class Measurable:
    """What could be measured in a room: its value, and what it changes by when planes move."""

    value: float
    """World unit, squared for areas and cubed for volumes."""
    gradient: FloatArray
    """(4S,) by each plane's (normal, normal · anchor + d)."""
    drawn_sigma: float = 0.0
    """σ of what no plane determines: where an outline was drawn, as that of a door in its wall."""

    def sigma(self, covariance: FloatArray) -> float:
        """σ by the (4S, 4S) joint covariance of all planes; NaN when it rests on a plane that nothing places."""
        rows = np.nonzero(self.gradient)[0]
        of_planes = propagated_sigma(self.gradient[rows], covariance[np.ix_(rows, rows)])
        return float(np.hypot(of_planes, self.drawn_sigma))

    def moved(self, step: FloatArray) -> Measurable:
        """The same after a (4S,) step of all planes."""
        return replace(self, value=self.value + float(self.gradient @ step))

    def plus(self, other: Measurable, factor: float = 1.0) -> Measurable:
        """The sum with ``factor`` times another; what was drawn of both is independent."""
        return Measurable(
            self.value + factor * other.value,
            self.gradient + factor * other.gradient,
            float(np.hypot(self.drawn_sigma, factor * other.drawn_sigma)),
        )

    def times(self, other: Measurable) -> Measurable:
        """The product with another; what was drawn of both is independent."""
        return Measurable(
            self.value * other.value,
            self.value * other.gradient + other.value * self.gradient,
            float(np.hypot(self.value * other.drawn_sigma, other.value * self.drawn_sigma)),
        )
