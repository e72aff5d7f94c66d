"""The edges of regions."""

from __future__ import annotations

from collections.abc import Iterator

import shapely
from shapely import MultiPolygon

from gtlayout.scene import FloatArray


def segments(region: MultiPolygon) -> Iterator[FloatArray]:
    """(2, 2) each edge of a region: polygon by polygon, outer ring first."""
    for polygon in region.geoms:
        for ring in (polygon.exterior, *polygon.interiors):
            points = shapely.get_coordinates(ring)
            for k in range(len(points) - 1):
                yield points[k : k + 2]
