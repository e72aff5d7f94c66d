"""Where a key frame shows that an instance is not: it draws something else there, or nothing."""

from __future__ import annotations

from collections.abc import Sequence

import shapely
from shapely.geometry.base import BaseGeometry

from gtlayout.closing_config import ClosingConfig
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.consensus import lift, own_members
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import half_plane, polygons
from gtlayout.instances import Instance, Plane, PlaneFrame
from gtlayout.scene import Scene


def contradicted(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    index: int,
    frame: PlaneFrame,
    max_depth: float,
    extent: ExtentConfig,
    config: ClosingConfig,
) -> BaseGeometry:
    """The part of an instance's plane, in its frame, where at least one key frame shows that it is not.

    Amodal outlines are drawn through furniture, so an instance that lies in the image is drawn there, unless another
    hides it. Where neither is drawn, the instance is not. What lies at a depth that is not known hides nothing.
    """
    own = own_members(instances, index)
    instance_of = {member: i for i, one in enumerate(instances) for member in one.members}
    found = []
    for k, key_frame in enumerate(scene.key_frames):
        camera = scene.frame_of(k).camera
        plane_inverse = inverse_depth(planes[index], camera)
        allowed: list[BaseGeometry] = []
        for e, element in enumerate(key_frame.elements):
            other = instance_of.get((k, e))
            if (k, e) in own:
                allowed.append(element.amodal)
            elif other is not None and planes[other].observable and not element.amodal.is_empty:
                nearer = (1 - extent.occluder_margin) * inverse_depth(planes[other], camera) - plane_inverse
                allowed.append(element.amodal.intersection(half_plane(nearer, element.amodal)))
        image = shapely.box(0, 0, camera.width, camera.height)
        free = polygons(image.difference(shapely.union_all(allowed)))
        inner = free.buffer(-config.border_px * camera.annotation_scale)
        found.append(lift(inner, planes[index], camera, frame, max_depth, extent))
    return shapely.union_all(found)
