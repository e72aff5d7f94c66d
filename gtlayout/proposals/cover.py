"""Outlines that share their borders: gaps closed, corners that nobody would draw left out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.polygons import polygons
from gtlayout.scene import FloatArray

_GRID_PX = 2.0**-10
"""Outlines are noded on this grid, so that neighbours have the very same corners."""


def cover(
    regions: Mapping[int, MultiPolygon], image: BaseGeometry, inverse_depths: Mapping[int, FloatArray], gap_px: float, step_px: float
) -> dict[int, MultiPolygon]:
    """The regions without gaps narrower than ``gap_px`` between them, with borders simplified to ``step_px``.

    A gap goes to the neighbour that lies farthest behind: where one surface hides another, its own end is what was
    drawn. Regions must not overlap. Borders of two regions stay one line.

    Args:
        regions: px, by instance.
        image: What they are part of.
        inverse_depths: (3,) coefficients of the inverse depth in the image, by instance.
        gap_px: Widest gap.
        step_px: Largest deviation of a border.
    """
    closed = dict(regions)
    for gap in _gaps(regions, image, gap_px):
        at = np.append(shapely.get_coordinates(gap.representative_point())[0], 1.0)
        beside = [i for i in regions if shapely.dwithin(regions[i], gap, 4 * _GRID_PX)]
        touching = {i: shapely.length(gap.boundary.intersection(regions[i].buffer(4 * _GRID_PX))) for i in beside}
        beside = [i for i in beside if touching[i] >= 0.25 * gap.boundary.length]
        if beside:
            behind = min(beside, key=lambda i: (float(at @ inverse_depths[i]), i))
            closed[behind] = polygons(shapely.union(closed[behind], gap))
    return _simplified(closed, image, step_px)


def _gaps(regions: Mapping[int, MultiPolygon], image: BaseGeometry, width_px: float) -> list[BaseGeometry]:
    free = polygons(image.difference(shapely.union_all(list(regions.values()))))
    wide = free.buffer(-width_px / 2, join_style="mitre").buffer(width_px / 2 + _GRID_PX, join_style="mitre")
    return list(polygons(free.difference(wide)).geoms)


def _simplified(regions: Mapping[int, MultiPolygon], image: BaseGeometry, step_px: float) -> dict[int, MultiPolygon]:
    borders = [region.boundary for region in (*regions.values(), image)]
    lines = shapely.union_all(borders, grid_size=_GRID_PX)
    chains = shapely.get_parts(shapely.line_merge(lines))
    straight = shapely.union_all(shapely.simplify(chains, step_px), grid_size=_GRID_PX)
    faces = shapely.get_parts(shapely.polygonize([straight]))
    shares = {i: shapely.area(shapely.intersection(faces, region)) / shapely.area(faces) for i, region in regions.items()}
    owner = np.array([max(shares, key=lambda i: shares[i][f]) for f in range(len(faces))])  # noqa: B023
    covered = np.array([max(share[f] for share in shares.values()) for f in range(len(faces))]) > 0.5
    return {i: polygons(shapely.coverage_union_all(faces[covered & (owner == i)])) for i in regions}
