"""What the key frames say of each instance: what every frame is proposed from, found once for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.extent.consensus import Faces, contradicting, faces_of, lift, tidy
from gtlayout.extent.extents import ended, plane_frame
from gtlayout.geometry.depth import median_depth
from gtlayout.geometry.overlap import image_motion
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import grid_for, half_plane, polygons
from gtlayout.instances import Extent, Instance, Member, Plane, PlaneFrame
from gtlayout.proposals.config import FillConfig, ProposalConfig
from gtlayout.scene import FloatArray, KeyFrame, Scene
from gtlayout.solution import Solution

_WIDE_PX = 1e-3
"""A line is cut out of another with this width on each side."""


@dataclass(frozen=True)
class SeenInstance:
    """What the key frames say of one instance whose plane is observable."""

    frame: PlaneFrame
    faces: Faces
    """Of its plane, on which key frames vote."""
    against: tuple[BaseGeometry, ...]
    """For each key frame where it shows something else, on or behind the plane; in ``frame``."""
    ends: dict[int, BaseGeometry]
    """By key frame that shows it: where it ends there and nothing nearer hides it, px lines."""
    drawn: dict[int, tuple[MultiPolygon, MultiPolygon]]
    """By key frame that shows it: all that is drawn of it, and the visible parts; in ``frame``."""

    def visible(self, weights: FloatArray) -> MultiPolygon:
        """Its visible parts, in ``frame``, by (K,) weights of the key frames; 0 = no say.

        Furniture stands before other parts of a plane in other images, so the key frame with the most weight of those
        that show the instance in a place decides there.
        """
        decided, seen = MultiPolygon(), MultiPolygon()
        for k in sorted((k for k in self.drawn if weights[k] > 0), key=lambda k: (-weights[k], k)):
            whole, part = self.drawn[k]
            new = shapely.difference(part, decided, grid_size=self.faces.grid)
            seen = polygons(shapely.union(seen, new, grid_size=self.faces.grid))
            decided = polygons(shapely.union(decided, whole, grid_size=self.faces.grid))
        return seen


def seen_instances(solution: Solution, config: FillConfig) -> tuple[SeenInstance | None, ...]:
    """For each instance what the key frames say; None for unobservable planes. It takes about as long as stage 5."""
    scene, layout, extent = solution.scene, solution.layout, solution.config.extent
    depth = median_depth(scene, layout.instances, layout.planes)
    max_depth, grid = extent.max_depth_ratio * depth, grid_for(depth)
    found: list[SeenInstance | None] = []
    for i, (instance, plane) in enumerate(zip(layout.instances, layout.planes, strict=True)):
        if not plane.observable:
            found.append(None)
            continue
        frame = plane_frame(plane, scene)
        faces = faces_of(scene, layout.instances, i, layout.planes, frame, max_depth, grid, extent)
        against = tuple(
            shapely.union_all(contradicting(scene, layout.instances, i, layout.planes, k, frame, max_depth, extent))
            for k in range(len(scene.key_frames))
        )
        ends = {
            member[0]: _ends(scene, layout.instances, layout.planes, i, member, config) for member in instance.members
        }
        drawn = {}
        for k in sorted(ends):
            camera = scene.frame_of(k).camera
            both = drawn_regions(scene.key_frames[k], [e for member_k, e in instance.members if member_k == k])
            whole, part = (lift(region, plane, camera, frame, max_depth, extent) for region in both)
            drawn[k] = whole, part
        found.append(SeenInstance(frame, faces, against, ends, drawn))
    return tuple(found)


def drawn_regions(key_frame: KeyFrame, members: Sequence[int]) -> tuple[BaseGeometry, BaseGeometry]:
    """All that is drawn of some elements of a key frame, and their visible parts, px.

    A key frame without any visible part says nothing of them: all of its elements are tracked as a whole.
    """
    elements = [key_frame.elements[e] for e in members]
    whole = shapely.union_all([element.amodal for element in elements])
    if all(element.visible.is_empty for element in key_frame.elements):
        return whole, whole
    return whole, shapely.union_all([element.visible for element in elements])


def nearby_extents(solution: Solution, seen: Sequence[SeenInstance | None], weights: FloatArray) -> tuple[Extent, ...]:
    """The extents on which key frames agree by their (K,) weights, not refined; empty for unobservable planes."""
    scene, layout, config = solution.scene, solution.layout, solution.config.extent
    extents = []
    for one, plane, instance, known in zip(seen, layout.planes, layout.instances, layout.extents, strict=True):
        if one is None:
            extents.append(Extent(known.frame, MultiPolygon(), MultiPolygon()))
            continue
        region = tidy(one.faces.by_weight(weights), one.faces.grid, config)
        cameras = [scene.frame_of(k).camera for k, _ in instance.members if weights[k] > 0]
        region = ended(region, plane, one.frame, cameras, one.faces.grid, config)
        extents.append(Extent(one.frame, region, region))
    return tuple(extents)


def weights_in(solution: Solution, frame: int, config: ProposalConfig) -> FloatArray:
    """(K,) how much each key frame has to say in a frame: the more, the less the image has moved; 0 for its own."""
    scene, camera = solution.scene, solution.scene.frames[frame].camera
    points = solution.layout.triangles.vertices
    weights: FloatArray = np.ones(len(scene.key_frames))
    for k, key_frame in enumerate(scene.key_frames):
        if key_frame.frame == frame:
            weights[k] = 0.0
        elif len(points):
            other = scene.frame_of(k).camera
            moved = (image_motion(points, other, camera) + image_motion(points, camera, other)) / 2
            weights[k] = (moved + config.least_motion) ** -config.nearness
    return weights


def _ends(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    index: int,
    member: Member,
    config: FillConfig,
) -> BaseGeometry:
    """The boundary of an element but for where something nearer hides what lies beyond; px lines."""
    key_frame, number = member
    elements, camera = scene.key_frames[key_frame].elements, scene.frame_of(key_frame).camera
    reach = config.hiding_px * camera.annotation_scale
    boundary, own = elements[number].amodal.boundary, inverse_depth(planes[index], camera)
    for other, instance in enumerate(instances):
        if other in (index, instances[index].host) or instance.host is not None or not planes[other].observable:
            continue
        nearer = (1 - config.occluder_margin) * inverse_depth(planes[other], camera) - own
        for region in (elements[e].amodal for k, e in instance.members if k == key_frame):
            beside = boundary.intersection(region.buffer(reach))
            if not beside.is_empty:
                hidden = beside.intersection(half_plane(nearer, beside))
                boundary = boundary.difference(hidden.buffer(_WIDE_PX))
    return boundary
