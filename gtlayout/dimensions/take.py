"""All dimensions and quantities of a solved room, with σ and level of accuracy."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.special import erf

from gtlayout.accuracy import SIGMAS_95, Accuracy, accuracy_of
from gtlayout.dimensions.areas import quantities
from gtlayout.dimensions.facing import Taken, distances
from gtlayout.dimensions.next_measurement import next_measurement
from gtlayout.dimensions.openings import opening_dimensions
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.geometry.strip import sigma_along_normal
from gtlayout.instances import Dimension, Extent, NextMeasurement, Plane, Quantity
from gtlayout.scene import FloatArray

_SAMPLES = 12
"""Points on a surface, along either axis of its bounds."""
_HALVINGS = 50


@dataclass(frozen=True)
class Dimensions:
    """What a room measures."""

    dimensions: tuple[Dimension, ...]
    quantities: tuple[Quantity, ...]
    accuracies: tuple[Accuracy, ...]
    """Of each instance, over its extent."""
    next_measurement: NextMeasurement | None
    """The dimension to measure by hand next."""


def all_dimensions(room: SolvedRoom) -> list[Taken]:
    """Heights and widths, then what doors and windows measure; their σ not yet known."""
    return [*distances(room.instances, room.planes, room.extents), *opening_dimensions(room)]


def take_dimensions(
    room: SolvedRoom, covariance: FloatArray, wanted_loa: int, astray: Collection[int] = ()
) -> Dimensions:
    """Every length, area and volume of a room, and how accurate they and the surfaces are.

    Levels of accuracy need metres: where the unit of a scene is not known, the evidence for them is insufficient. A
    length to a surface that only its neighbours place is *inferred*.

    Args:
        covariance: (4S, 4S) joint covariance of all planes in the world, about their anchor.
        wanted_loa: The level that everything is held against.
        astray: Instances whose extents are out of all proportion, and that have no area.
    """
    metric = room.scene.metric
    taken = all_dimensions(room)
    placed_so = {i for i in room.seen if by_neighbours(room, i)}
    dimensions = []
    for dimension, measured in taken:
        sigma = measured.sigma(covariance)
        inferred = bool({dimension.first, dimension.second} & placed_so)
        accuracy = accuracy_of(sigma if metric else np.nan, wanted_loa, inferred=inferred)
        dimensions.append(replace(dimension, sigma=sigma, accuracy=accuracy))
    amounts = [
        replace(one, sigma=measured.sigma(covariance))
        for one, measured in quantities(room, [each for each in taken if each[0].kind == "height"], astray)
    ]
    surfaces = [
        surface_accuracy(plane, extent, wanted_loa) if metric else accuracy_of(np.nan, wanted_loa)
        for plane, extent in zip(room.planes, room.extents, strict=True)
    ]
    following = next_measurement(taken, covariance, wanted_loa, metric, placed_so)
    return Dimensions(tuple(dimensions), tuple(amounts), tuple(surfaces), following)


def by_neighbours(room: SolvedRoom, index: int) -> bool:
    """Whether only contacts with neighbours tell the place of an instance; of a door or window, of its wall, too."""
    host, support = room.instances[index].host, room.planes[index].support
    return support.tracks == 0 and (support.contact_edges > 0 if host is None else by_neighbours(room, host))


def surface_accuracy(plane: Plane, extent: Extent, wanted_loa: int) -> Accuracy:
    """The accuracy of a surface over its whole extent: 95 % of its points lie nearer to where it is represented.

    In a scene in metres. A tilted plane is off by more at its ends than in its middle; the error is that of a random
    point of the extent on a random plane of the covariance.
    """
    if not plane.observable or extent.region.is_empty:
        return accuracy_of(np.nan, wanted_loa)
    sigma = sigma_along_normal(plane, extent, extent.frame.to_world(_spread(extent)))
    low, high = 0.0, 3 * SIGMAS_95 * float(sigma.max())
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        within = float(np.mean(erf(middle / np.sqrt(2) / np.maximum(sigma, 1e-300))))
        low, high = (low, middle) if within >= 0.95 else (middle, high)
    return accuracy_of(high / SIGMAS_95, wanted_loa)


def _spread(extent: Extent) -> FloatArray:
    """(N, 2) points spread evenly over an extent; its corners where it is too thin for any."""
    low, high = np.reshape(extent.region.bounds, (2, 2))
    shares = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    grid = np.stack(np.meshgrid(*(low[a] + shares * (high[a] - low[a]) for a in range(2))), axis=-1).reshape(-1, 2)
    inside = grid[shapely.contains_xy(extent.region, grid)]
    return inside if len(inside) else shapely.get_coordinates(extent.region)
