"""What is known to be room: all between a camera and what it sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.closing.plan import Plan, swept
from gtlayout.closing.walls import Wall
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.consensus import lift, own_members
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Extent
from gtlayout.layout import Layout
from gtlayout.prediction.predict import predict
from gtlayout.scene import FloatArray, Scene


@dataclass(frozen=True)
class Sight:
    """What one key frame sees of one instance, furniture thought away."""

    index: int
    """Of the instance."""
    eye: FloatArray
    """(2,) the camera in plan."""
    rings: tuple[FloatArray, ...]
    """(N, 2) in plan, closed."""


def sights(
    scene: Scene,
    plan: Plan,
    layout: Layout,
    shown: Sequence[int],
    max_depth: float,
    margin: float,
    config: ExtentConfig,
) -> tuple[Sight, ...]:
    """What each key frame sees of the instances ``shown``, as far as no nearer extent hides it.

    Walls are taken to be taller by ``margin``, world unit, both ways.
    """
    instances, planes, extents = layout.instances, layout.planes, layout.extents
    cameras = [scene.frame_of(k).camera for k in range(len(scene.key_frames))]
    taller = [
        replace(extent, region=_taller(extent, margin * plan.up)) if instance.label == "wall" else extent
        for instance, extent in zip(instances, extents, strict=True)
    ]
    visible = [predict(planes, taller, instances, camera).visible for camera in cameras]
    found = []
    for i in shown:
        own, frame = own_members(instances, i), extents[i].frame
        both = [j for j, instance in enumerate(instances) if i in (j, instance.host)]
        for k, key_frame in enumerate(scene.key_frames):
            drawn = [element.amodal for e, element in enumerate(key_frame.elements) if (k, e) in own]
            if not drawn:
                continue
            region_px = shapely.union_all(drawn).intersection(shapely.union_all([visible[k][j] for j in both]))
            camera = scene.frame_of(k).camera
            region = lift(region_px, planes[i], camera, frame, max_depth, config)
            rings = [
                plan.frame.to_plane(frame.to_world(shapely.get_coordinates(part.exterior))) for part in region.geoms
            ]
            if rings:
                found.append(Sight(i, plan.frame.to_plane(camera.center_world[None])[0], tuple(rings)))
    return tuple(found)


def _taller(extent: Extent, by: FloatArray) -> MultiPolygon:
    """The region of a wall with a margin above and below: nothing is seen through gaps that errors leave there."""
    up = extent.frame.axes @ by
    return swept(swept(extent.region, up), -2 * up) if not extent.region.is_empty else extent.region


def free_space(sights: Sequence[Sight], walls: Mapping[int, Wall], grid: float) -> MultiPolygon:
    """In plan, at the height of the ``walls``, all between the cameras and what they see.

    Over each of its points some ray passes, or ends, so that there is floor below it and a ceiling above.
    """
    triangles = []
    for sight in sights:
        for ring in sight.rings:
            if sight.index in walls:
                wall = walls[sight.index]
                along = ring @ wall.along
                ring = np.stack([wall.at(float(along.min())), wall.at(float(along.max()))])  # noqa: PLW2901
            starts, ends = ring[:-1], ring[1:]
            eyes = np.broadcast_to(sight.eye, starts.shape)
            triangles.append(shapely.polygons(np.stack([eyes, starts, ends], axis=1)))
            if sight.index not in walls:
                triangles.append(np.array([shapely.make_valid(shapely.polygons(ring))]))
    if not triangles:
        return MultiPolygon()
    pieces = np.concatenate(triangles)
    pieces = pieces[shapely.area(pieces) > 0]
    return polygons(shapely.union_all(pieces, grid_size=grid))


def inner(free: BaseGeometry, same: float) -> BaseGeometry:
    """Without a margin of ``same``: what lies there may as well lie on its border."""
    return free.buffer(-same, join_style="mitre")
