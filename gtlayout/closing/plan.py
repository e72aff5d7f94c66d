"""A room in plan: world points seen along the vertical, and how planes are traced there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.polygons import polygons
from gtlayout.geometry.rays import nonzero
from gtlayout.instances import Plane, PlaneFrame
from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class Plan:
    """The level plane that a room is drawn on."""

    frame: PlaneFrame
    """Its axes; their normal points up."""

    @property
    def up(self) -> FloatArray:
        """(3,) unit vector."""
        return np.cross(self.frame.axes[0], self.frame.axes[1])

    def upright_on(self, plane: Plane, points: FloatArray) -> FloatArray:
        """(N, 3) world points of a plane that lie above or below (N, 2) points of the plan."""
        level = self.frame.to_world(points)
        height = -(level @ plane.normal + plane.d) / nonzero(plane.normal @ self.up)
        return level + height[:, None] * self.up

    def onto(self, plane: Plane, frame: PlaneFrame, region: BaseGeometry) -> MultiPolygon:
        """A region of the plan on a plane that is not upright, in that plane's frame."""
        return polygons(shapely.transform(region, lambda points: frame.to_plane(self.upright_on(plane, points))))

    def trace(self, plane: Plane, surface: Plane) -> FloatArray:
        """(3,) the line in plan in which two planes meet: a u + b v + c = 0, positive before ``plane``."""
        points = self.upright_on(surface, np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        value = points @ plane.normal + plane.d
        return np.array([value[1] - value[0], value[2] - value[0], value[0]])


def crossing(first: FloatArray, second: FloatArray) -> FloatArray:
    """(2,) where two (3,) lines meet; far away for parallel ones."""
    point = np.cross(first, second)
    return point[:2] / nonzero(point[2])


def swept(region: MultiPolygon, by: FloatArray) -> MultiPolygon:
    """A region and all that it passes when it is moved by a (2,) vector."""
    found = [region]
    for polygon in region.geoms:
        ring = shapely.get_coordinates(polygon.exterior)
        quads = np.stack([ring[:-1], ring[1:], ring[1:] + by, ring[:-1] + by], axis=1)
        found += list(shapely.make_valid(shapely.polygons(quads)))
    return polygons(shapely.union_all(found))
