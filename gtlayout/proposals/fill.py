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

from gtlayout.geometry.depth import median_depth
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Extent
from gtlayout.proposals.config import FillConfig
from gtlayout.proposals.seen import SeenInstance
from gtlayout.scene import BoolArray, FloatArray, Scene
from gtlayout.solution import Solution

_SAMPLES = 8
"""Points of an edge of which it is asked whether a key frame shows the surface ending there."""
_FAN = 6
"""Corners of the arc between two edges that never meet."""
_PARALLEL = 1e-3
"""Sine of the angle of two lines that do not cross."""
_TOUCHING = 1e-6
"""Of a region's size: a part this near touches it."""


def filled(
    solution: Solution,
    seen: Sequence[SeenInstance | None],
    extents: Sequence[Extent],
    key_frames: Sequence[int],
    config: FillConfig,
) -> tuple[Extent, ...]:
    """The extents with all around them that they may cover, as far as the given key frames show."""
    scene, layout = solution.scene, solution.layout
    reach = config.reach_depths * median_depth(scene, layout.instances, layout.planes)
    grown = []
    for extent, one, instance in zip(extents, seen, layout.instances, strict=True):
        if one is None or extent.region.is_empty:
            grown.append(extent)
            continue
        wedges: list[BaseGeometry] = []
        for polygon in extent.region.geoms:
            simple = shapely.simplify(polygon, config.simplify_share * np.sqrt(polygon.area))
            ring = shapely.get_coordinates(shapely.orient_polygons(simple).exterior)[:-1]
            closed = closed_edges(scene, one, ring, key_frames, config)
            cos = config.parallel_cos if instance.host is not None else -1.0
            wedges += wedges_over_open(ring, closed, reach, cos)
        against = shapely.union_all([one.against[k] for k in key_frames])
        grown.append(replace(extent, region=_with_touching(extent.region, shapely.union_all(wedges) - against)))
    return tuple(grown)


def closed_edges(
    scene: Scene, seen: SeenInstance, ring: FloatArray, key_frames: Sequence[int], config: FillConfig
) -> BoolArray:
    """(N,) for each edge of a ring of (N, 2) points in the instance's plane whether a key frame shows that it ends.

    Edge n runs from point n to the next.
    """
    following = np.roll(ring, -1, axis=0)
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    samples = seen.frame.to_world((ring[:, None] + share[:, None] * (following - ring)[:, None]).reshape(-1, 2))
    shown = np.zeros(len(samples), dtype=bool)
    for k in key_frames:
        if k in seen.ends:
            camera = scene.frame_of(k).camera
            scale = camera.annotation_scale
            px, depth = camera.project(samples)
            inside = np.minimum(px, [camera.width, camera.height] - px).min(axis=1) > config.border_px * scale
            there = inside & (depth > 0)
            shown[there] |= shapely.dwithin(seen.ends[k], shapely.points(px[there]), config.closed_px * scale)
    length = np.linalg.norm(following - ring, axis=1)
    long = length > config.min_closed_share * np.sqrt(Polygon(ring).area)
    closed: BoolArray = long & (shown.reshape(-1, _SAMPLES).mean(axis=1) >= 0.5)
    return closed


def wedges_over_open(ring: FloatArray, closed: BoolArray, reach: float, min_cos: float) -> Iterator[BaseGeometry]:
    """What lies beyond each run of open edges of a counter-clockwise ring, between the closed ones beside it.

    Args:
        ring: (N, 2).
        closed: (N,) of its edges; without any, all within ``reach`` is given, unless ``min_cos`` forbids it.
        reach: How far edges that do not meet go on.
        min_cos: Of the directions of two edges between which anything lies; -1 = any.
    """
    count = len(ring)
    if not closed.any() and min_cos == -1:
        yield shapely.box(*(ring.min(axis=0) - reach), *(ring.max(axis=0) + reach))
    for k in np.nonzero(closed)[0]:
        last = k + 1
        while not closed[last % count]:
            last += 1
        if last == k + 1:
            continue
        # The run goes from the end of closed edge k to the start of the next closed one.
        run = ring[np.arange(k + 1, last + 1) % count]
        before, after = run[0] - ring[k], run[-1] - ring[(last + 1) % count]
        before, after = before / np.linalg.norm(before), after / np.linalg.norm(after)
        if before @ after >= min_cos:
            yield shapely.make_valid(Polygon([*run, *_beyond(run[-1], after, run[0], before, reach)]))


def _beyond(start: FloatArray, out: FloatArray, end: FloatArray, back: FloatArray, reach: float) -> list[FloatArray]:
    """The corners from ``start`` along ``out``, and along ``back`` from the far side to ``end``; all (2,).

    One, where the lines cross; else a fan at ``reach``.
    """
    across = np.column_stack([out, -back])
    if abs(np.linalg.det(across)) > _PARALLEL:
        first, second = np.linalg.solve(across, end - start)
        if 0 < first < reach and 0 < second < reach:
            return [start + first * out]
    angle = np.arctan2(out[1], out[0])
    # Outside is on the right of a counter-clockwise ring, so the fan turns clockwise …
    turn = (np.arctan2(back[1], back[0]) - angle) % (-2 * np.pi)
    # … but between edges that would meet beyond the reach, which turn a little the other way.
    turn += 2 * np.pi if turn < -1.5 * np.pi else 0.0
    share = np.linspace(0, 1, _FAN)
    angles, origins = angle + share * turn, start + share[:, None] * (end - start)
    return list(origins + reach * np.column_stack([np.cos(angles), np.sin(angles)]))


def _with_touching(region: MultiPolygon, free: BaseGeometry) -> MultiPolygon:
    near = _TOUCHING * float(np.sqrt(region.area))
    parts = [part for part in polygons(free).geoms if shapely.dwithin(part, region, near)]
    return polygons(shapely.union_all([region, *parts]))
