"""What a camera sees of a layout, as an annotator would draw it: polygons in the image, ordered by depth.

``gtlayout.geometry.render`` gives pixels of the same. Here outlines stay exact, so that they can be drawn and compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import buffered, half_plane, polygons
from gtlayout.geometry.render import project_rings
from gtlayout.instances import Extent, Instance, Plane
from gtlayout.prediction.config import PredictionConfig
from gtlayout.scene import SAME_BORDER_PX, Camera, FloatArray


@dataclass(frozen=True)
class OcclusionEdge:
    """A line in the image along which one instance hides another that does not touch it there."""

    front: int
    """Index of the instance that is nearer."""
    behind: int
    points_px: FloatArray
    """(N, 2) polyline."""


@dataclass(frozen=True)
class Prediction:
    """What one camera must see of a layout."""

    amodal: tuple[MultiPolygon, ...]
    """Per instance its whole outline within the image, px; empty when none of it lies there."""
    visible: tuple[MultiPolygon, ...]
    """Per instance the part that no nearer instance hides, px; these do not overlap. An opening hides its host."""


def predict(
    planes: Sequence[Plane], extents: Sequence[Extent], instances: Sequence[Instance], camera: Camera
) -> Prediction:
    """What ``camera`` sees of a layout: one plane and one extent for each instance, in the world of the camera."""
    inverse = [inverse_depth(plane, camera) for plane in planes]
    amodal = tuple(outline(extent, camera) for extent in extents)
    shown = [i for i, region in enumerate(amodal) if not region.is_empty]
    hiding: dict[int, list[BaseGeometry]] = {i: [] for i in shown}
    for front, behind in permutations(shown, 2):
        if shapely.intersects(amodal[front], amodal[behind]):
            hiding[behind].append(_hiding(front, behind, amodal[front], inverse, instances))
    visible = [MultiPolygon()] * len(amodal)
    for i in shown:
        visible[i] = polygons(amodal[i].difference(shapely.union_all(hiding[i])))
    return Prediction(amodal, tuple(visible))


def occlusion_edges(
    prediction: Prediction,
    planes: Sequence[Plane],
    instances: Sequence[Instance],
    camera: Camera,
    config: PredictionConfig,
) -> tuple[OcclusionEdge, ...]:
    """Where a predicted instance hides a neighbour that lies clearly behind it, one piece each, by pairs of instances.

    ``prediction`` is what ``camera`` sees of the ``planes``.
    """
    shown = [i for i, region in enumerate(prediction.visible) if not region.is_empty]
    inverse = {i: inverse_depth(planes[i], camera) for i in shown}
    return tuple(
        OcclusionEdge(front, behind, points)
        for front, behind in permutations(shown, 2)
        if behind != instances[front].host
        for points in _jumps(
            prediction.visible[front], prediction.visible[behind], inverse[front], inverse[behind], camera, config
        )
    )


def outline(extent: Extent, camera: Camera) -> MultiPolygon:
    """An extent in the image, px, whatever hides it."""
    region: BaseGeometry = MultiPolygon()
    image = shapely.box(0, 0, camera.width, camera.height)
    for ring in project_rings(extent, camera):
        # Even-odd: a hole takes away what its outer ring brings.
        region = region.symmetric_difference(polygons(Polygon(ring)).intersection(image))
    return polygons(region)


def _hiding(
    front: int,
    behind: int,
    whole: MultiPolygon,
    inverse: Sequence[FloatArray],
    instances: Sequence[Instance],
) -> BaseGeometry:
    """The part of the ``whole`` outline of instance ``front`` in which it hides what the image shows of ``behind``."""
    if instances[front].host == behind:
        return whole
    nearer = inverse[front] - inverse[behind]
    if instances[behind].host == front or not np.isfinite(nearer).all():
        return MultiPolygon()
    # Two instances on one plane: the first is seen.
    if not nearer.any():
        return whole if front < behind else MultiPolygon()
    return whole.intersection(half_plane(nearer, whole))


def _jumps(
    front: MultiPolygon,
    behind: MultiPolygon,
    inverse_front: FloatArray,
    inverse_behind: FloatArray,
    camera: Camera,
    config: PredictionConfig,
) -> list[FloatArray]:
    """(N, 2) px polylines: where the boundary of a visible region runs along another one that lies clearly behind."""
    reach = SAME_BORDER_PX * camera.annotation_scale
    image = shapely.box(0, 0, camera.width, camera.height)
    if front.is_empty or behind.is_empty or not shapely.dwithin(front, behind, reach):
        return []
    inner = front.boundary.difference(buffered(image.exterior, reach))
    along = inner.intersection(behind.buffer(reach))
    if along.is_empty:
        return []
    clearly = (1 - config.min_depth_jump) * inverse_front - inverse_behind
    jump = along.intersection(half_plane(clearly, along))
    lines = [part for part in shapely.get_parts(jump) if part.geom_type == "LineString"]
    merged = shapely.get_parts(shapely.line_merge(shapely.multilinestrings(lines))) if lines else []
    # Shorter pieces are the ends of other borders that lie within reach.
    return [shapely.get_coordinates(line) for line in merged if line.length > 2 * reach]
