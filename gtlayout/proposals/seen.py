"""The extents as the key frames near a frame show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shapely import MultiPolygon

from gtlayout.extent.consensus import Faces, faces_of, tidy
from gtlayout.extent.extents import ended, plane_frame
from gtlayout.geometry.depth import median_depth
from gtlayout.geometry.overlap import image_motion
from gtlayout.geometry.polygons import grid_for
from gtlayout.instances import Extent, PlaneFrame
from gtlayout.proposals.config import ProposalConfig
from gtlayout.scene import Camera, FloatArray
from gtlayout.solution import Solution


@dataclass(frozen=True)
class SeenInstance:
    """What all key frames say of where an instance is."""

    frame: PlaneFrame
    faces: Faces | None
    """None for unobservable planes."""


def seen_instances(solution: Solution) -> tuple[SeenInstance, ...]:
    """For each instance of the layout what the key frames say: the costly part, of which any frame is proposed."""
    scene, layout, config = solution.scene, solution.layout, solution.config.extent
    depth = median_depth(scene, layout.instances, layout.planes)
    max_depth, grid = config.max_depth_ratio * depth, grid_for(depth)
    found = []
    for i, plane in enumerate(layout.planes):
        frame = plane_frame(plane, scene)
        faces = faces_of(scene, layout.instances, i, layout.planes, frame, max_depth, grid, config) if plane.observable else None
        found.append(SeenInstance(frame, faces))
    return tuple(found)


def nearby_extents(
    solution: Solution, seen: Sequence[SeenInstance], weights: FloatArray
) -> tuple[Extent, ...]:
    """The extents on which key frames agree by their (K,) weights, not refined."""
    scene, layout, config = solution.scene, solution.layout, solution.config.extent
    extents = []
    for one, plane, instance in zip(seen, layout.planes, layout.instances, strict=True):
        region = MultiPolygon()
        if one.faces is not None:
            region = tidy(one.faces.by_weight(weights), one.faces.grid, config)
            cameras = [scene.frame_of(k).camera for k, _ in instance.members if weights[k] > 0]
            region = ended(region, plane, one.frame, cameras, one.faces.grid, config)
        extents.append(Extent(one.frame, region, region))
    return tuple(extents)


def weights_for(solution: Solution, frame: int, config: ProposalConfig) -> FloatArray:
    """(K,) how much each key frame has to say in a frame: the more, the less the image has moved; 0 for its own."""
    scene, camera = solution.scene, solution.scene.frames[frame].camera
    points = solution.layout.triangles.vertices
    if len(points) == 0:
        return np.ones(len(scene.key_frames))
    moved = np.array([_motion(points, scene.frame_of(k).camera, camera) for k in range(len(scene.key_frames))])
    own = np.array([key_frame.frame == frame for key_frame in scene.key_frames])
    return np.where(own, 0.0, (moved + config.least_motion) ** -config.nearness)


def _motion(points_world: FloatArray, a: Camera, b: Camera) -> float:
    return (image_motion(points_world, a, b) + image_motion(points_world, b, a)) / 2
