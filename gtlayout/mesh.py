"""Stage 6: triangles with labels, sharing their vertices where instances touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from shapely import MultiPoint, MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.polygons import grid_for, polygons
from gtlayout.geometry.strip import pieces, sigma_along_normal
from gtlayout.instances import Extent, Instance, Mesh, Plane
from gtlayout.scene import FloatArray, IntArray

_WELD_SHARE = 1e-3
"""Vertices closer than this share of the layout's size are one: a few millimetres in a room."""
_WIDEST = 3.0
"""Vertices that are one lie within so many times that of each other."""
_SAME_SHARE = 1e-6
"""Distances that differ by less than this share of that are equal."""
_GRID_STEPS = 32.0
"""The grid of triangles is so many times coarser than that of extents: what moves there by a step stays here."""


def build_mesh(instances: Sequence[Instance], extents: Sequence[Extent]) -> Mesh:
    """Triangulate every extent; openings are cut out of their hosts, so that nothing is drawn twice.

    Where two instances touch, each takes over the other's vertices along the common line and both are welded there.
    """
    outlines = [extent.frame.to_world(shapely.get_coordinates(extent.region)) for extent in extents]
    everything = np.concatenate(outlines) if outlines else np.empty((0, 3))
    if len(everything) == 0:
        return Mesh.empty()
    size = float(np.linalg.norm(np.ptp(everything, axis=0)))
    reach, grid = _WELD_SHARE * size, _GRID_STEPS * grid_for(size)
    regions = [
        polygons(
            shapely.difference(
                extent.region,
                _openings_in(extent, [extents[j] for j in range(len(extents)) if instances[j].host == i]),
                grid_size=grid,
            )
        )
        for i, extent in enumerate(extents)
    ]
    corners = [
        extent.frame.to_world(shapely.get_coordinates(region)) for region, extent in zip(regions, extents, strict=True)
    ]
    triangles, corners_uv, owners = [], [], []
    for i, (region, extent) in enumerate(zip(regions, extents, strict=True)):
        others = np.concatenate([corner for j, corner in enumerate(corners) if j != i] or [np.empty((0, 3))])
        taken = _take_over(region, extent, others, reach, grid)
        for part in (part for piece in pieces(taken, extent.frame) for part in _triangulate(piece)):
            triangles.append(extent.frame.to_world(part))
            corners_uv.append(part)
            owners.append(i)
    if not triangles:
        return Mesh.empty()
    vertices, index = _weld(np.concatenate(triangles), np.concatenate(corners_uv), np.repeat(owners, 3), reach)
    faces = index.reshape(-1, 3)
    # Welding can close a sliver.
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return Mesh(vertices, faces[proper], np.array(owners, dtype=np.int64)[proper])


def vertex_sigma(mesh: Mesh, planes: Sequence[Plane], extents: Sequence[Extent]) -> FloatArray:
    """(V,) σ of the surface's position along its normal at each vertex, world unit.

    Where instances share a vertex it is the largest of theirs; NaN for a vertex that no triangle uses. The σ of a depth
    seen there is this divided by the cosine between the normal and the viewing direction.
    """
    sigma = np.full(len(mesh.vertices), np.nan)
    for i in np.unique(mesh.face_instance):
        own = np.unique(mesh.faces[mesh.face_instance == i])
        sigma[own] = np.fmax(sigma[own], sigma_along_normal(planes[i], extents[i], mesh.vertices[own]))
    return sigma


def _openings_in(host: Extent, openings: Sequence[Extent]) -> BaseGeometry:
    """The openings' outlines, dropped onto the host's plane, in its frame."""
    return shapely.union_all(
        [
            polygons(shapely.transform(one.region, lambda uv, frame=one.frame: host.frame.to_plane(frame.to_world(uv))))
            for one in openings
        ]
    )


def _take_over(
    region: MultiPolygon, extent: Extent, others_world: FloatArray, reach: float, grid: float
) -> MultiPolygon:
    """A region whose boundary passes through the vertices of others that lie on it, to the grid's precision."""
    if region.is_empty or len(others_world) == 0:
        return region
    uv = extent.frame.to_plane(others_world)
    height = np.linalg.norm(others_world - extent.frame.to_world(uv), axis=1)
    near = uv[height < reach]
    boundary = region.boundary
    shapely.prepare(boundary)
    near = near[shapely.dwithin(boundary, shapely.points(near), reach)] if len(near) else near
    # On the grid, or rounding chooses the diagonals of rectangles. Snapping may pinch a thin part to a line: dropped.
    near = grid * np.round(near / grid)
    snapped = polygons(shapely.snap(region, MultiPoint(near), reach)) if len(near) else region
    return snapped if abs(snapped.area - region.area) < 0.1 * region.area else region


def _triangulate(region: MultiPolygon) -> list[FloatArray]:
    """(3, 2) corners of each triangle, counter-clockwise."""
    found = shapely.get_parts(shapely.constrained_delaunay_triangles(region))
    triangles = []
    for triangle in found:
        corners = shapely.get_coordinates(triangle)[:3]
        (a, b), (c, d) = corners[1] - corners[0], corners[2] - corners[0]
        triangles.append(corners if a * d - b * c > 0 else corners[::-1])
    return triangles


def _weld(points: FloatArray, uv: FloatArray, owner: IntArray, reach: float) -> tuple[FloatArray, IntArray]:
    """Vertices, and the vertex of every point.

    Points of different instances within ``reach`` become one, at their mean, and with them what else of these instances
    is near, as slivers at a corner are; those of one instance alone only where they are the same corner.

    Args:
        points: (N, 3) corners of triangles, world.
        uv: (N, 2) the same in the frames of their instances.
        owner: (N,) instance of each.
        reach: world unit.
    """
    _, first, corner = np.unique(np.column_stack([owner, uv]), axis=0, return_index=True, return_inverse=True)
    representative = first[_merged(points[first], owner[first], reach)[corner]]
    links = coo_array((np.ones(len(points)), (np.arange(len(points)), representative)), shape=(len(points),) * 2)
    count, vertex = connected_components(links, directed=False)
    sums = np.column_stack([np.bincount(vertex, weights=axis, minlength=count) for axis in points.T])
    return sums / np.bincount(vertex, minlength=count)[:, None], vertex.astype(np.int64)


def _merged(points: FloatArray, owner: IntArray, reach: float) -> IntArray:
    """(N,) the point that stands for each: those of different owners within ``reach`` are linked, nearest first.

    Links chain, but no group becomes wider than ``_WIDEST`` times the reach: two fine outlines that run side by side
    would shrink to a point.
    """
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    pairs = pairs[owner[pairs[:, 0]] != owner[pairs[:, 1]]]
    # Rounded, so that of pairs as near the first comes first.
    steps = np.round(np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1) / (_SAME_SHARE * reach))
    group = np.arange(len(points))
    members = {i: [i] for i in range(len(points))}
    for i, j in pairs[np.lexsort((pairs[:, 1], pairs[:, 0], steps))].tolist():
        kept, joined = sorted((int(group[i]), int(group[j])))
        if kept != joined and cdist(points[members[kept]], points[members[joined]]).max() <= _WIDEST * reach:
            group[members[joined]] = kept
            members[kept] += members.pop(joined)
    return group
