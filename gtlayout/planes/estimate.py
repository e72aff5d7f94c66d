"""The result of stage 4."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gtlayout.geometry.similarity import Similarity, covariance_by
from gtlayout.instances import ContactOffsets, Plane
from gtlayout.planes.trail import PlaneTrail
from gtlayout.scene import FloatArray, IntArray


@dataclass(frozen=True)
class Iteration:
    """The result of one Levenberg-Marquardt iteration, for plots. The first is the start."""

    cost: float
    planes: FloatArray
    """(instances, 4) normal and d."""


@dataclass(frozen=True)
class Estimate:
    """Planes, their covariance and how they were found, all in one world."""

    planes: tuple[Plane, ...]
    """One per instance."""
    covariance: FloatArray
    """(4S, 4S) joint covariance of all planes' (normal, normal · anchor + d); NaN for those that are not placed."""
    landmarks: FloatArray
    """(N, 3) position of each track's point; NaN where a track was not used."""
    landmark_weight: FloatArray
    """(N,) robust weight in [0, 1] after the solve; near 0 = the track was outvoted."""
    landmark_instance: IntArray
    """(N,) instance whose plane it lies on, -1 = none."""
    contact_offsets: ContactOffsets
    """Of all contacts whose planes are placed."""
    iterations: tuple[Iteration, ...]
    warnings: tuple[str, ...] = ()
    """Problems during the solve, one line each."""
    trails: tuple[PlaneTrail, ...] = ()
    """What each kind of evidence says of each plane by itself."""

    def to_world(self, local: Similarity, anchor: FloatArray) -> Estimate:
        """The estimate in the world that ``local`` is a form of, with covariances that refer to ``anchor``, (3,) there.

        Those of this estimate must refer to the origin.
        """
        coefficients = np.array([[*plane.normal, plane.d] for plane in self.planes])
        world, jacobian = local.planes_to_world(coefficients, anchor)
        return replace(
            self,
            planes=tuple(
                replace(
                    plane,
                    normal=at[:3],
                    d=float(at[3]),
                    covariance=covariance_by(plane.covariance, jacobian),
                    anchor=anchor,
                )
                for plane, at in zip(self.planes, world, strict=True)
            ),
            covariance=covariance_by(self.covariance, jacobian),
            landmarks=local.points_to_world(self.landmarks),
            contact_offsets={pair: local.vectors_to_world(offset) for pair, offset in self.contact_offsets.items()},
            iterations=tuple(Iteration(one.cost, local.planes_to_world(one.planes)[0]) for one in self.iterations),
            trails=tuple(trail.to_world(local) for trail in self.trails),
        )
