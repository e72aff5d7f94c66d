"""Where the elements of an instance lie on a plane, and what key frames show there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.extent.config import ExtentConfig
from gtlayout.geometry.plane_image import clip_to_plane, inverse_depth, unproject
from gtlayout.geometry.polygons import polygons
from gtlayout.geometry.raster import annotated_labels, spread_points
from gtlayout.instances import Instance, Plane, PlaneFrame
from gtlayout.scene import SAME_BORDER_PX, FloatArray, Scene

_POINTS = 40
"""Points spread over each element."""


@dataclass(frozen=True)
class UnprojectedElements:
    """Some elements, unprojected on one plane."""

    points: FloatArray
    """(P, 3) spread over all of them, world."""
    depth: FloatArray
    """(P,) at which their key frames see these."""
    region: MultiPolygon
    """Their union, in the plane's own frame; empty when none of them can lie on the plane."""


def unproject_elements(
    scene: Scene, members: Sequence[tuple[int, int]], plane: Plane, max_depth: float, config: ExtentConfig
) -> UnprojectedElements:
    """Unproject the elements ``members``, (key frame, element) each, on ``plane``."""
    frame = PlaneFrame.across(plane.normal, -plane.d * plane.normal)
    points, depth, regions = [np.empty((0, 3))], [np.empty(0)], []
    for k, element in members:
        camera = scene.frame_of(k).camera
        amodal = scene.key_frames[k].elements[element].amodal
        seen = polygons(clip_to_plane(amodal, plane, camera, max_depth, config.min_horizon_px))
        if not seen.is_empty:
            points.append(unproject(spread_points(seen, _POINTS), plane, camera))
            depth.append(camera.project(points[-1])[1])
            lifted = shapely.transform(seen, lambda px: frame.to_plane(unproject(px, plane, camera)))  # noqa: B023
            regions.append(polygons(lifted))
    return UnprojectedElements(np.concatenate(points), np.concatenate(depth), polygons(shapely.union_all(regions)))


def visibility_votes(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    index: int,
    other_part: int,
    points_world: FloatArray,
    config: ExtentConfig,
) -> tuple[int, int]:
    """What the key frames of instance ``index`` show where (P, 3) points of ``other_part`` should be.

    Anything nearer than the points may hide them and does not count.

    Returns:
        How often they show instance ``index`` or an opening in one of the two, and how often anything else.
    """
    same = other = 0
    for k, _ in instances[index].members:
        camera = scene.frame_of(k).camera
        px, depth = camera.project(points_world)
        inside = (depth > 0) & (px >= 0).all(axis=1) & (px < (camera.width, camera.height)).all(axis=1)
        px, depth = px[inside], depth[inside]
        shown = annotated_labels(scene, instances, k)[px[:, 1].astype(int), px[:, 0].astype(int)]
        drawn = [
            scene.key_frames[k].elements[e].amodal
            for i, instance in enumerate(instances)
            for frame, e in instance.members
            if frame == k and (i == index or instance.host in (index, other_part))
        ]
        shown[shapely.contains_xy(shapely.union_all(drawn).buffer(SAME_BORDER_PX), px)] = index
        for i in np.unique(shown[shown >= 0]).tolist():
            here = shown == i
            if planes[i].observable:
                inverse = np.column_stack([px[here], np.ones(len(px[here]))]) @ inverse_depth(planes[i], camera)
                count = int(np.count_nonzero(inverse * (1 - config.occluder_margin) <= 1 / depth[here]))
                same, other = (same + count, other) if i == index else (same, other + count)
    return same, other
