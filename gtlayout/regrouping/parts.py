"""Elements that cannot lie on the plane of their instance: on it they would reach through the floor or the ceiling.

Where nothing can be tracked, elements are joined by what lies near them in the image, and a near wall may be taken for
the one that it hides. The wall behind ends at the ceiling; what was drawn of the near one goes on beyond that line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from gtlayout.extent.config import ExtentConfig
from gtlayout.geometry.depth import median_depth
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import half_plane, homogeneous
from gtlayout.instances import Member, Plane
from gtlayout.prepared.measurements import Measurements
from gtlayout.regrouping.config import RegroupingConfig
from gtlayout.regrouping.on_plane import unproject_elements
from gtlayout.scene import Camera, Element


@dataclass(frozen=True)
class Part:
    """An element that is not what the other members of its instance are."""

    member: Member
    instance: int
    bound: int
    """Index of the floor or ceiling that it would reach through."""


def find_parts(
    measured: Measurements, planes: Sequence[Plane], config: RegroupingConfig, extent: ExtentConfig
) -> tuple[Part, ...]:
    """The elements of walls that reach far through a floor or ceiling at which their wall ends in other key frames.

    An element stays where it is when something of its own says that it lies on the plane: tracks, a contact with that
    floor or ceiling, or one with another instance that is placed without it.
    """
    parts = []
    for i, instance in enumerate(measured.instances):
        for member in instance.members:
            if not _vouched(measured, planes, i, member, config):
                bound = reaches_through(measured, planes, member, i, config, extent)
                if bound is not None:
                    parts.append(Part(member, i, bound))
    return tuple(parts)


def reaches_through(
    measured: Measurements,
    planes: Sequence[Plane],
    member: Member,
    index: int,
    config: RegroupingConfig,
    extent: ExtentConfig,
) -> int | None:
    """The floor or ceiling through which an element would reach on the plane of instance ``index``, a wall.

    None without such a one: where the wall is known to end must be seen in other key frames, and not in this one.
    """
    scene, instances = measured.scene, measured.instances
    k, e = member
    others = [other for other in instances[index].members if other[0] != k]
    if instances[index].label != "wall" or not planes[index].observable or len(others) < config.min_others:
        return None
    max_depth = extent.max_depth_ratio * median_depth(scene, instances, planes)
    for j, key_frames in _ends(measured, index).items():
        if k not in key_frames and planes[j].observable:
            element, camera = scene.key_frames[k].elements[e], scene.frame_of(k).camera
            if _is_beyond(element, planes[index], planes[j], camera, config):
                points = unproject_elements(scene, others, planes[index], max_depth, extent).points
                if np.mean(points @ planes[j].normal + planes[j].d < 0) <= config.max_others_beyond:
                    return j
    return None


def _ends(measured: Measurements, index: int) -> dict[int, set[int]]:
    """The floors and ceilings that an instance touches, each with the key frames that show it."""
    touching: dict[int, set[int]] = {}
    for edge in measured.edges:
        if index in edge.instances:
            (j,) = set(edge.instances) - {index}
            if measured.instances[j].label in ("floor", "ceiling"):
                touching.setdefault(j, set()).add(edge.key_frame)
    return {j: touching[j] for j in sorted(touching)}


def _vouched(
    measured: Measurements, planes: Sequence[Plane], index: int, member: Member, config: RegroupingConfig
) -> bool:
    """Whether an element has evidence of its own for the plane of instance ``index``."""
    k, e = member
    sampled = (measured.tracks.key_frame == k) & (measured.tracks.element == e) & (measured.track_instance == index)
    if np.count_nonzero(sampled) >= config.min_tracks:
        return True
    touched = [edge.instances for edge in measured.edges if edge.key_frame == k and index in edge.instances]
    supports = [planes[b if a == index else a].support for a, b in touched]
    return any(support.tracks > 0 or support.contact_edges > 1 for support in supports)


def _is_beyond(element: Element, plane: Plane, bound: Plane, camera: Camera, config: RegroupingConfig) -> bool:
    """Whether much of an element, taken to lie on ``plane``, is on the far side of ``bound``."""
    # At a pixel n·X + d of a point on the plane is D (1 - ρ_bound / ρ_plane), with D that of the camera.
    distance = float(bound.normal @ camera.center_world) + bound.d
    beyond = distance * (inverse_depth(bound, camera) - inverse_depth(plane, camera))
    region = element.amodal.intersection(half_plane(beyond, element.amodal))
    if region.area < config.min_beyond_share * element.amodal.area:
        return False
    corners = homogeneous(shapely.get_coordinates(region))
    reach_px = float((corners @ beyond).max() / np.hypot(beyond[0], beyond[1]))
    return reach_px >= config.min_beyond_px * camera.annotation_scale
