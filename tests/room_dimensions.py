"""Heights and widths of made rooms with their σ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gtlayout.dimensions.facing import distances
from gtlayout.instances import Dimension, Extent, Instance, Plane
from gtlayout.scene import FloatArray


def room_dimensions(
    instances: Sequence[Instance], planes: Sequence[Plane], extents: Sequence[Extent], covariance: FloatArray
) -> tuple[Dimension, ...]:
    """Distances of what faces each other, with σ by the (4S, 4S) joint covariance of the planes."""
    taken = distances(instances, planes, extents)
    return tuple(replace(dimension, sigma=measured.sigma(covariance)) for dimension, measured in taken)
