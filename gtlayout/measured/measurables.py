"""The length or angle of a solved room that each measurement by hand is of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from gtlayout.dimensions.facing import MAX_ANGLE_DEG, Taken, distance_between
from gtlayout.dimensions.measurable import Measurable
from gtlayout.dimensions.openings import opening_dimensions
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.errors import GtlayoutError
from gtlayout.geometry.marked_points import Mark, triangulated
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import DimensionKind, propagated_sigma
from gtlayout.measurement import MeasuredKind, Measurement
from gtlayout.scene import OPENINGS

_OF_OPENING: dict[MeasuredKind, DimensionKind] = {
    "width": "opening width",
    "height": "opening height",
    "sill": "sill",
}
_LEAST_SINE = 0.1
"""Of an angle; the cosine of smaller ones hardly depends on the planes."""


class NotMeasurableError(Exception):
    """Why a measurement has nothing in the layout that it is of."""


def instances_of(room: SolvedRoom, measurement: Measurement) -> list[int]:
    """Indices of the instances that a measurement names: by an element of each, where one is given, else by name.

    Raises NotMeasurableError when the layout has none.
    """
    elements = measurement.elements or (None,) * len(measurement.instances)
    found = []
    for name, element in zip(measurement.instances, elements, strict=True):
        if element is None:
            matches = [i for i, instance in enumerate(room.instances) if instance.name == name]
        else:
            matches = [
                i
                for i, instance in enumerate(room.instances)
                for k, e in instance.members
                if room.scene.frame_of(k).name == element.image
                and room.scene.key_frames[k].elements[e].id == element.element
            ]
        if not matches:
            drawn = "" if element is None else f" (element {element.element} of {element.image})"
            raise NotMeasurableError(f"the layout has no instance {name}{drawn}")
        if matches[0] not in room.seen:
            raise NotMeasurableError(f"{room.instances[matches[0]].name} has no place")
        found.append(matches[0])
    return found


def measurable_of(room: SolvedRoom, measurement: Measurement) -> Measurable:
    """What a measurement is of, in world units or radians. Raises NotMeasurableError when that is nothing."""
    if measurement.kind == "points":
        return _points(room, measurement)
    of = instances_of(room, measurement)
    if curved := [room.instances[i].name for i in of if strip_of(room.extents[i])]:
        raise NotMeasurableError(f"{curved[0]} is curved, and measurements are of planes")
    if measurement.kind == "between":
        return _between(room, of)
    if measurement.kind == "angle":
        return _angle(room, of)
    index, kind = of[0], _OF_OPENING[measurement.kind]
    if room.instances[index].label not in OPENINGS:
        raise NotMeasurableError(f"{room.instances[index].name} is neither door nor window")
    found = [
        measured
        for dimension, measured in opening_dimensions(room)
        if dimension.kind == kind and index == (dimension.second if kind == "sill" else dimension.first)
    ]
    if not found:
        raise NotMeasurableError(f"the {measurement.kind} of {room.instances[index].name} is not seen whole")
    return found[0]


def _between(room: SolvedRoom, of: Sequence[int]) -> Measurable:
    """The distance of two planes: between what faces each other there, else from the middle of one to the other."""
    a, b = of
    taken: Taken | None = distance_between(room.planes, room.extents, a, b, "width")
    taken = taken or distance_between(room.planes, room.extents, b, a, "width")
    if taken is not None:
        return taken[1]
    first, second = room.planes[a], room.planes[b]
    if abs(first.normal @ second.normal) < np.cos(np.deg2rad(MAX_ANGLE_DEG)):
        names = f"{room.instances[a].name} and {room.instances[b].name}"
        raise NotMeasurableError(f"{names} are further than {MAX_ANGLE_DEG:g}° from parallel, so they have no distance")
    extent = room.extents[a]
    middle = extent.frame.to_world(shapely.get_coordinates(extent.region.centroid))[0]
    signed = float(second.normal @ middle + second.d)
    gradient = second.normal @ room.motion(a, middle[None], [[]])[0]
    gradient[4 * b : 4 * b + 4] += room.moved_by(b, middle)
    return Measurable(abs(signed), np.sign(signed) * gradient)


def _angle(room: SolvedRoom, of: Sequence[int]) -> Measurable:
    """Between the normals, radians."""
    a, b = of
    first, second = room.planes[a].normal, room.planes[b].normal
    sine = float(np.linalg.norm(np.cross(first, second)))
    if sine < _LEAST_SINE:
        raise NotMeasurableError("angles below 6° or above 174° are not used")
    gradient = np.zeros(4 * len(room.planes))
    gradient[4 * a : 4 * a + 3], gradient[4 * b : 4 * b + 3] = -second / sine, -first / sine
    return Measurable(float(np.arctan2(sine, first @ second)), gradient)


def _points(room: SolvedRoom, measurement: Measurement) -> Measurable:
    """The distance of two marked points: no plane, only cameras and marks determine it."""
    cameras = {frame.name: frame.camera for frame in room.scene.frames}
    found = []
    for number, point in enumerate(measurement.points, start=1):
        marks = [Mark(name, cameras[name], np.array(px)) for name, px in point if name in cameras]
        try:
            found.append(triangulated(marks, f"point {number}"))
        except GtlayoutError as reason:
            raise NotMeasurableError(str(reason)) from reason
    between = found[1][0] - found[0][0]
    distance = float(np.linalg.norm(between))
    if distance == 0:
        raise NotMeasurableError("its two points are one")
    sigma = float(propagated_sigma(between / distance, found[0][1] + found[1][1]))
    return Measurable(distance, np.zeros(4 * len(room.planes)), sigma)
