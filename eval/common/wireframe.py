"""What a camera sees of a layout, as vectors: the visible region of each segment and the edges between regions.

A *segment* is what 2D layout methods predict: floor, ceiling or a wall, with the doors and windows in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Literal

import numpy as np
import shapely
from shapely import LineString, MultiLineString, MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import half_plane, polygons
from gtlayout.instances import Extent, Instance
from gtlayout.layout import Layout
from gtlayout.scene import BoolArray, Camera, FloatArray, IntArray

GAP_PX = 2.0
"""Extents of neighbours may leave a gap this wide, or end this far from where their planes meet."""
CONTACT_SHARE = 0.01
"""Segments whose depths differ by no more than this share touch."""
MIN_PX = 3.0
"""Shorter edges are left out, and shorter changes of kind along an edge."""
SIMPLIFY_PX = 0.5
"""Vertices that move an edge by less are left out."""
STEP_PX = 2.0
"""What kind an edge is is decided once in so many px."""
_SNAP_PX = 0.02
"""Regions computed one by one share their boundary to within this."""
_GRID_PX = 1e-4
"""Overlays are computed on this grid: on bare floating point numbers they can fail."""

Kind = Literal["contact", "occlusion"]


@dataclass(frozen=True)
class Edge:
    """A line in the image along which one segment ends and another begins."""

    segments: tuple[int, int]
    """Indices into the segments; of an occlusion edge the nearer one first."""
    kind: Kind
    """``contact``: the planes meet in 3D; ``occlusion``: one hides where the other goes on or ends."""
    points_px: FloatArray
    """(N, 2) polyline."""


def segments_of(instances: Sequence[Instance]) -> list[list[int]]:
    """The instances each segment is made of, first the one that names it.

    Doors and windows belong to the wall that hosts them; without a host they are segments of their own.
    """
    groups = {i: [i] for i, instance in enumerate(instances) if instance.host is None}
    for i, instance in enumerate(instances):
        if instance.host is not None:
            groups[instance.host].append(i)
    return list(groups.values())


def visible_regions(layout: Layout, camera: Camera) -> list[MultiPolygon]:
    """The part of the image (px) in which each instance is seen: the vector form of ``geometry.render.render``.

    A host is not cut by its openings, so it and they may overlap. Which of two planes is nearer changes only along the
    image of their intersection line: what hides a polygon is cut off by half-planes, without sampling.
    """
    image = shapely.box(0, 0, camera.width, camera.height)
    inverse = [inverse_depth(plane, camera) for plane in layout.planes]
    drawn = [
        _in_image(extent, camera) if np.isfinite(inverse[i]).all() else MultiPolygon()
        for i, extent in enumerate(layout.extents)
    ]
    owner = [i if instance.host is None else instance.host for i, instance in enumerate(layout.instances)]
    seen = []
    for i, region in enumerate(drawn):
        others = [j for j, other in enumerate(drawn) if owner[j] != owner[i] and other.intersects(region)]
        hiding = [polygons(drawn[j].intersection(half_plane(inverse[j] - inverse[i], image))) for j in others]
        hidden = shapely.union_all(hiding, grid_size=_GRID_PX)
        seen.append(polygons(shapely.difference(region, hidden, grid_size=_GRID_PX)))
    return seen


def visible_edges(layout: Layout, camera: Camera) -> list[Edge]:
    """The edges between segments as the camera sees them, in the order of the segments.

    Where a segment borders on nothing or on the image border, there is none.
    """
    segments = segments_of(layout.instances)
    seen = visible_regions(layout, camera)
    inverse = np.array([inverse_depth(plane, camera) for plane in layout.planes]).reshape(-1, 3)
    regions = _close_gaps(
        [polygons(shapely.union_all([seen[i] for i in members], grid_size=_GRID_PX)) for members in segments]
    )
    border = shapely.box(0, 0, camera.width, camera.height).exterior.buffer(_SNAP_PX)
    edges = []
    for a, b in combinations(range(len(segments)), 2):
        for line in _shared_boundary(regions[a], regions[b], border):
            points = shapely.get_coordinates(shapely.segmentize(line, STEP_PX))
            middles = (points[1:] + points[:-1]) / 2
            planes_a, planes_b = (inverse[_instance_at(middles, segments[e], seen)] for e in (a, b))
            touching = _touch(planes_a, planes_b, middles)
            nearer = _at(planes_a - planes_b, middles)
            for first, last in _runs(touching, np.linalg.norm(np.diff(points, axis=0), axis=1)):
                piece = shapely.get_coordinates(LineString(points[first : last + 1]).simplify(SIMPLIFY_PX))
                if np.mean(touching[first:last]) >= 0.5:
                    edges.append(Edge((a, b), "contact", piece))
                else:
                    front_first = (a, b) if np.median(nearer[first:last]) >= 0 else (b, a)
                    edges.append(Edge(front_first, "occlusion", piece))
    return edges


def _in_image(extent: Extent, camera: Camera) -> MultiPolygon:
    """The extent as it would be seen alone, px: cut on its plane by the planes through the image border, projected.

    Cutting first keeps what is beside or behind the camera from being projected at all.
    """
    region = polygons(extent.region)
    corners = np.array([[0, 0], [camera.width, 0], [camera.width, camera.height], [0, camera.height]], dtype=np.float64)
    rays = camera.rays_world(corners)
    for k in range(4):
        inward = np.cross(rays[k], rays[(k + 1) % 4])
        side = np.append(extent.frame.axes @ inward, (extent.frame.origin - camera.center_world) @ inward)
        if region.is_empty:
            break
        region = polygons(region.intersection(half_plane(side, region)))
    return polygons(shapely.transform(region, lambda uv: camera.project(extent.frame.to_world(uv))[0]))


def _close_gaps(regions: Sequence[MultiPolygon]) -> list[MultiPolygon]:
    """Each region with its part of the narrow gaps, so that neighbours share their boundary."""
    covered = shapely.union_all(regions, grid_size=_GRID_PX)
    closed = covered.buffer(GAP_PX / 2, join_style="mitre").buffer(-GAP_PX / 2, join_style="mitre")
    gaps = polygons(shapely.difference(closed, covered, grid_size=_GRID_PX))
    filled = []
    for region in regions:
        near = region.buffer(GAP_PX / 2, join_style="mitre")
        part = polygons(shapely.intersection(gaps, near, grid_size=_GRID_PX))
        gaps = polygons(shapely.difference(gaps, part, grid_size=_GRID_PX))
        filled.append(polygons(shapely.union(region, part, grid_size=_GRID_PX)))
    return filled


def _shared_boundary(a: MultiPolygon, b: MultiPolygon, border: BaseGeometry) -> list[LineString]:
    """The pieces of a's boundary along b, but for the image border and crumbs."""
    if a.is_empty or b.is_empty or shapely.distance(a, b) > _SNAP_PX:
        return []
    along = a.boundary.intersection(b.buffer(_SNAP_PX)).difference(border)
    lines = [part for part in shapely.get_parts(along) if isinstance(part, LineString) and part.length > 0]
    merged = shapely.line_merge(MultiLineString(lines))
    return [line for line in shapely.get_parts(merged) if line.length >= MIN_PX]


def _instance_at(points_px: FloatArray, members: Sequence[int], seen: Sequence[MultiPolygon]) -> IntArray:
    """(N,) which of a segment's instances is seen at (N, 2) points on its boundary: an opening before its host."""
    order = [*members[1:], members[0]]
    distances = np.array([shapely.distance(seen[i], shapely.points(points_px)) for i in order])
    # Those of an empty region are NaN; what is nearer by less than a gap is not really nearer.
    steps = np.floor(np.nan_to_num(distances, nan=np.inf) / GAP_PX)
    return np.array(order)[np.argmin(steps, axis=0)]


def _touch(planes_a: FloatArray, planes_b: FloatArray, points_px: FloatArray) -> BoolArray:
    """(N,) whether planes, (N, 3) inverse depths as in ``inverse_depth``, meet at or close to (N, 2) points.

    Close is measured in the image, from the planes' intersection line, and for planes that are nearly the same, whose
    line may be anywhere, in depth.
    """
    difference = planes_a - planes_b
    gap = np.abs(_at(difference, points_px))
    nearer = np.maximum(_at(planes_a, points_px), _at(planes_b, points_px))
    slope = np.hypot(difference[:, 0], difference[:, 1])
    return (gap <= GAP_PX * slope) | (gap <= CONTACT_SHARE * nearer)


def _at(coefficients: FloatArray, points_px: FloatArray) -> FloatArray:
    """(N,) a x + b y + c, row by row."""
    return np.sum(coefficients[:, :2] * points_px, axis=1) + coefficients[:, 2]


def _runs(kinds: BoolArray, lengths_px: FloatArray) -> list[tuple[int, int]]:
    """Stretches [first, last) of one kind; shorter ones than ``MIN_PX`` go to the stretch before them."""
    bounds = [0, *(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(kinds)]
    runs: list[tuple[int, int]] = []
    for first, last in pairwise(bounds):
        same = runs and kinds[runs[-1][0]] == kinds[first]
        if runs and (same or lengths_px[first:last].sum() < MIN_PX):
            runs[-1] = (runs[-1][0], last)
        else:
            runs.append((first, last))
    return runs
