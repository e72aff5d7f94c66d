"""Extents beyond what was drawn: where a surface ends only because nobody saw it further, it goes on.

An outline is *closed* where a key frame shows the surface ending there, and *open* elsewhere. Over each run of open
edges the closed ones beside it go straight on to where they meet. What a key frame shows to be something else is taken
away again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.consensus import contradicting
from gtlayout.geometry.depth import median_depth
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import half_plane, polygons
from gtlayout.instances import Extent, Instance, Member, Plane, PlaneFrame
from gtlayout.proposals.config import ProposalConfig
from gtlayout.scene import BoolArray, FloatArray, Scene

_SAMPLES = 8
"""Points of an edge of which it is asked whether a key frame shows a boundary there."""
OCCLUDER_MARGIN = 0.05
_PARALLEL = 0.9
_FAN_STEPS = 6
"""Corners of the arc between two edges that never meet."""


def filled(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    extents: Sequence[Extent],
    key_frames: Sequence[int],
    config: ProposalConfig,
    extent_config: ExtentConfig,
) -> tuple[Extent, ...]:
    """The extents with everything around them that they may cover; what is drawn is part of it.

    ``key_frames`` are those that have a say.
    """
    reach = config.reach_depths * median_depth(scene, instances, planes)
    max_depth = extent_config.max_depth_ratio / config.reach_depths * reach
    grown = []
    for i, extent in enumerate(extents):
        if extent.region.is_empty or not planes[i].observable:
            grown.append(extent)
            continue
        wedges = []
        for polygon in extent.region.geoms:
            simple = shapely.simplify(polygon, config.simplify_share * np.sqrt(polygon.area))
            ring = shapely.get_coordinates(shapely.geometry.polygon.orient(simple).exterior)[:-1]
            closed = closed_edges(scene, instances, i, planes, extent.frame, ring, key_frames, config)
            wedges += list(open_wedges(ring, closed, reach, opening=instances[i].host is not None))
        against = [
            region
            for k in key_frames
            for region in contradicting(scene, instances, i, planes, k, extent.frame, max_depth, extent_config)
        ]
        free = shapely.difference(shapely.union_all(wedges), shapely.union_all(against))
        grown.append(replace(extent, region=_touching(extent.region, free)))
    return tuple(grown)


def closed_edges(
    scene: Scene,
    instances: Sequence[Instance],
    index: int,
    planes: Sequence[Plane],
    frame: PlaneFrame,
    ring: FloatArray,
    key_frames: Sequence[int],
    config: ProposalConfig,
) -> BoolArray:
    """(N,) for each edge of a ring of (N, 2) points whether key frames show the instance ending there.

    The edge n runs from point n to the next. Where something nearer hides the rest, it does not end.
    """
    following = np.roll(ring, -1, axis=0)
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    samples = frame.to_world((ring[:, None] + share[:, None] * (following - ring)[:, None]).reshape(-1, 2))
    shown = np.zeros(len(samples), dtype=bool)
    for k, element in instances[index].members:
        if k not in key_frames:
            continue
        camera = scene.frame_of(k).camera
        px, depth = camera.project(samples)
        scale = camera.annotation_scale
        inside = np.minimum(px, [camera.width, camera.height] - px).min(axis=1) > config.border_px * scale
        ends = _ends(scene, instances, index, planes, (k, element), config.closed_px * scale)
        there = (depth > 0) & inside
        shown[there] |= shapely.dwithin(ends, shapely.points(px[there]), config.closed_px * scale)
    length = np.linalg.norm(following - ring, axis=1)
    long = length > config.min_closed_share * np.sqrt(Polygon(ring).area)
    return long & (shown.reshape(-1, _SAMPLES).mean(axis=1) >= 0.5)


def _ends(
    scene: Scene,
    instances: Sequence[Instance],
    index: int,
    planes: Sequence[Plane],
    member: Member,
    reach_px: float,
) -> BaseGeometry:
    """The boundary of an element but for what is hidden there by nearer elements; px."""
    k, element = member
    boundary = scene.key_frames[k].elements[element].amodal.boundary
    camera = scene.frame_of(k).camera
    own = inverse_depth(planes[index], camera)
    for other, instance in enumerate(instances):
        if other == index or instance.host is not None or not planes[other].observable:
            continue
        for number in (e for kk, e in instance.members if kk == k):
            region = scene.key_frames[k].elements[number].amodal
            if other == instances[index].host or not shapely.dwithin(region, boundary, reach_px):
                continue
            nearer = (1 - OCCLUDER_MARGIN) * inverse_depth(planes[other], camera) - own
            near = boundary.intersection(region.buffer(reach_px / 2))
            if not near.is_empty:
                boundary = boundary.difference(near.intersection(half_plane(nearer, near)).buffer(1e-3))
    return boundary


def open_wedges(ring: FloatArray, closed: BoolArray, reach: float, *, opening: bool) -> Iterator[BaseGeometry]:
    """What lies outside each run of open edges of a counter-clockwise ring of (N, 2), between the edges beside it."""
    count = len(ring)
    if not closed.any():
        if opening:
            return
        low, high = ring.min(axis=0) - reach, ring.max(axis=0) + reach
        yield shapely.box(*low, *high)
        return
    for k in np.nonzero(closed)[0]:
        ends = k + 1
        while not closed[ends % count]:
            ends += 1
        if ends == k + 1:
            continue
        # The open run goes from the end of closed edge k to the start of the next closed edge.
        run = ring[np.arange(k + 1, ends + 1) % count]
        before, after = run[0] - ring[k], run[-1] - ring[(ends + 1) % count]
        before, after = before / np.linalg.norm(before), after / np.linalg.norm(after)
        if opening and before @ after < _PARALLEL:
            continue
        yield shapely.make_valid(Polygon([*run, *_outside(run[-1], after, run[0], before, reach)]))


def _outside(
    start: FloatArray, start_along: FloatArray, end: FloatArray, end_along: FloatArray, reach: float
) -> list[FloatArray]:
    """The corners from ``start`` straight on and back to ``end``: where both lines cross, or a fan at ``reach``."""
    matrix = np.column_stack([start_along, -end_along])
    if abs(np.linalg.det(matrix)) > 1e-3:
        first, second = np.linalg.solve(matrix, end - start)
        if 0 < first < reach and 0 < second < reach:
            return [start + first * start_along]
    angle_0 = np.arctan2(start_along[1], start_along[0])
    # Counter-clockwise rings have their outside on the right, so the fan turns clockwise from the end's direction.
    turn = (np.arctan2(end_along[1], end_along[0]) - angle_0) % (-2 * np.pi)
    # Edges that would meet farther away turn a little the other way.
    turn += 2 * np.pi if turn < -1.5 * np.pi else 0.0
    share = np.linspace(0, 1, _FAN_STEPS)
    angles = angle_0 + share * turn
    origins = start + share[:, None] * (end - start)
    return list(origins + reach * np.column_stack([np.cos(angles), np.sin(angles)]))


def _touching(region: MultiPolygon, free: BaseGeometry) -> MultiPolygon:
    """The region with the free parts beside it."""
    size = 1e-6 * np.sqrt(region.area)
    parts = [part for part in polygons(free).geoms if shapely.dwithin(part, region, size)]
    return polygons(shapely.union_all([region, *parts]))
