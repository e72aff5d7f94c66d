"""The edges of regions, and the grid that their corners lie on."""

from __future__ import annotations

from collections.abc import Iterator

import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.polygons import polygons
from gtlayout.scene import FloatArray

GRID_PX = 0.01
"""Neighbours have the very same corners on it. Tools write and show corners to so much: what does not cross itself here
does not cross itself there."""


def on_grid(region: BaseGeometry) -> MultiPolygon:
    """The region with its corners on the grid, valid; needles that are narrower go."""
    return polygons(shapely.set_precision(region, GRID_PX))


def segments(region: MultiPolygon) -> Iterator[FloatArray]:
    """(2, 2) each edge of a region: polygon by polygon, outer ring first."""
    for polygon in region.geoms:
        for ring in (polygon.exterior, *polygon.interiors):
            points = shapely.get_coordinates(ring)
            for k in range(len(points) - 1):
                yield points[k : k + 2]
