"""Stage 4: initial planes, factor graph, Levenberg-Marquardt, marginals."""

from __future__ import annotations

from dataclasses import dataclass

from gtlayout.layout import Plane
from gtlayout.scene import FloatArray, IntArray


@dataclass(frozen=True)
class Iteration:
    """One Levenberg-Marquardt iteration, for plots."""

    cost: float
    planes: FloatArray
    """(instances, 4) normal and d in the world."""


@dataclass(frozen=True)
class Estimate:
    """What stage 4 hands on."""

    planes: tuple[Plane, ...]
    """One per instance; openings repeat their host's."""
    landmarks: FloatArray
    """(N, 3) world position of each track's point; NaN where a track was not used."""
    landmark_weight: FloatArray
    """(N,) robust weight in [0, 1] after the solve; near 0 = the track was outvoted."""
    landmark_instance: IntArray
    """(N,) instance whose plane it lies on, -1 = none."""
    iterations: tuple[Iteration, ...]
