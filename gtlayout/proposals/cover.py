"""Outlines that share their borders: gaps closed, and corners that nobody would draw left out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.polygons import polygons
from gtlayout.proposals.outlines import GRID_PX
from gtlayout.scene import FloatArray

_BESIDE = 0.25
"""Share of a gap's boundary that a region must have to take it."""


def cover(
    regions: Mapping[int, MultiPolygon],
    image: Polygon,
    inverse_depths: Mapping[int, FloatArray],
    gap_px: float,
    step_px: float,
) -> dict[int, MultiPolygon]:
    """The regions without narrow gaps between them, and with simpler borders that stay one line for both sides.

    A gap goes to the neighbour that lies farthest behind: where one surface hides another, its own end was drawn.

    Args:
        regions: px, by instance; they do not overlap.
        image: What they are part of.
        inverse_depths: (3,) coefficients of the inverse depth in the image, by instance.
        gap_px: Width up to which gaps are closed.
        step_px: Largest deviation of a border.
    """
    closed = dict(regions)
    for gap in _gaps(regions, image, gap_px):
        at = np.append(shapely.get_coordinates(gap.representative_point())[0], 1.0)
        shared = {i: gap.boundary.intersection(region.buffer(4 * GRID_PX)).length for i, region in regions.items()}
        beside = [i for i in regions if shared[i] >= _BESIDE * gap.boundary.length]
        if beside:
            behind = min(beside, key=lambda i: (float(at @ inverse_depths[i]), i))
            closed[behind] = polygons(shapely.union(closed[behind], gap))
    return _simplified(closed, image, step_px)


def _gaps(regions: Mapping[int, MultiPolygon], image: Polygon, width_px: float) -> list[BaseGeometry]:
    free = polygons(image.difference(shapely.union_all(list(regions.values()))))
    with np.errstate(divide="ignore", invalid="ignore"):  # GEOS, where corners all but coincide
        inner = free.buffer(-width_px / 2, join_style="mitre")
        wide = inner.buffer(width_px / 2 + GRID_PX, join_style="mitre")
    return list(polygons(free.difference(wide)).geoms)


def _simplified(regions: Mapping[int, MultiPolygon], image: Polygon, step_px: float) -> dict[int, MultiPolygon]:
    """Each chain of border from one junction to the next is simplified once, for the regions on both sides of it."""
    borders = [region.boundary for region in (*regions.values(), image)]
    chains = shapely.get_parts(shapely.line_merge(shapely.union_all(borders, grid_size=GRID_PX)))
    straight = shapely.union_all(shapely.simplify(chains, step_px), grid_size=GRID_PX)
    faces = shapely.get_parts(shapely.polygonize([straight]))
    keys = list(regions)
    shares = np.array([shapely.area(shapely.intersection(faces, regions[i])) for i in keys]) / shapely.area(faces)
    owner, covered = shares.argmax(axis=0), shares.max(axis=0) > 0.5
    return {
        i: polygons(shapely.normalize(shapely.coverage_union_all(faces[covered & (owner == number)])))
        for number, i in enumerate(keys)
    }
