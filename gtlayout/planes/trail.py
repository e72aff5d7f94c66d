"""What each kind of evidence says of a plane by itself, beside the answer of all together. Plain data."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtlayout.geometry.similarity import Similarity
from gtlayout.instances import Plane
from gtlayout.scene import FloatArray

_CHI2_99 = (np.nan, 6.635, 9.210, 11.345)
"""What χ² of so many degrees of freedom exceeds in 1 of 100 cases."""


@dataclass(frozen=True)
class EvidenceAlone:
    """What one kind of evidence says of a plane, with all other planes where the solution has them.

    Where a kind does not determine the offset or the normal, these are NaN: one contact edge leaves a plane free to
    turn about it.
    """

    kind: str
    """``tracks``, ``contact edges`` …"""
    measurements: int
    """How many tracks, edges … there are."""
    offset: float
    """From the solution's plane to this one, along the normal, so towards the cameras; at the middle of what is drawn,
    world unit."""
    sigma_offset: float
    """With what the σ of the other planes adds, world unit."""
    tilt_deg: float
    """Angle between the two normals."""
    sigma_normal_deg: float
    """σ of the normal's direction: the larger of its two principal axes."""
    chi2: float
    """χ² of the difference between what this kind says and what all other kinds say; NaN where the others say
    nothing."""
    freedom: int
    """Its degrees of freedom, at most 3: the directions in which both sides know the plane."""

    @property
    def agrees(self) -> bool | None:
        """Whether χ² is below its 99 % quantile; None where there is nothing to compare with."""
        return None if self.freedom == 0 else self.chi2 <= _CHI2_99[self.freedom]


@dataclass(frozen=True)
class PlaneTrail:
    """Where a plane is compared, and what each kind of evidence says of it alone; none for one that is not placed."""

    middle: FloatArray
    """(3,) point on the plane, amid what is drawn of it; NaN without plane."""
    alone: tuple[EvidenceAlone, ...]

    def to_world(self, local: Similarity) -> PlaneTrail:
        """The same in the world that ``local`` is a form of."""
        return PlaneTrail(local.points_to_world(self.middle), self._in_unit(1 / local.scale))

    def measured(self, factor: float, plane: Plane) -> PlaneTrail:
        """The same beside the ``plane`` that measurements moved it to, in a world whose unit is smaller by ``factor``.

        The offsets of each kind are from that plane on.
        """
        middle = factor * self.middle
        shift = float(plane.normal @ middle + plane.d)
        alone = tuple(replace(one, offset=one.offset + shift) for one in self._in_unit(factor))
        return PlaneTrail(middle - shift * plane.normal, alone)

    def _in_unit(self, factor: float) -> tuple[EvidenceAlone, ...]:
        return tuple(
            replace(one, offset=factor * one.offset, sigma_offset=factor * one.sigma_offset) for one in self.alone
        )
