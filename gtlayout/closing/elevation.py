"""Walls seen from the front."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.closing.plan import Plan
from gtlayout.closing.walls import Wall
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Plane, PlaneFrame
from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class Elevation:
    """A wall's own plane as (along, height) over the plan; affine in its frame."""

    matrix: FloatArray
    """(2, 2)"""
    offset: FloatArray
    """(2,)"""
    frame: PlaneFrame

    @classmethod
    def of(cls, plan: Plan, wall: Wall, frame: PlaneFrame) -> Elevation:
        """That of a wall whose frame is given."""
        world_to = np.stack([wall.along @ plan.frame.axes, plan.up])
        return cls(world_to @ frame.axes.T, world_to @ (frame.origin - plan.frame.origin), frame)

    def seen(self, region: BaseGeometry) -> MultiPolygon:
        """A region in the wall's frame, here."""
        return polygons(shapely.transform(region, lambda uv: uv @ self.matrix.T + self.offset))

    def in_frame(self, region: BaseGeometry) -> MultiPolygon:
        """The inverse of ``seen``."""
        inverse = np.linalg.inv(self.matrix)
        return polygons(shapely.transform(region, lambda points: (points - self.offset) @ inverse.T))

    def before(self, plane: Plane) -> FloatArray:
        """(3,) a line here: positive where the wall lies before another plane."""
        inverse = np.linalg.inv(self.matrix)
        corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        value = self.frame.to_world((corners - self.offset) @ inverse.T) @ plane.normal + plane.d
        return np.array([value[1] - value[0], value[2] - value[0], value[0]])
