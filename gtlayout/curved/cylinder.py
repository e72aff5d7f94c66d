"""An upright cylinder with its covariance: plain data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class Cylinder:
    """The surface of all points whose level distance from an axis is the radius."""

    origin: FloatArray
    """(3,) world point amid the wall. The variables below refer to its level."""
    axes: FloatArray
    """(3, 3) unit vectors, rows: two level ones, and upwards as the floor has it; right-handed."""
    values: FloatArray
    """(5,): where the axis passes through the origin's level along the level axes, world unit; the radius; and how far
    the axis leans along them per unit of height."""
    covariance: FloatArray
    """(5, 5) of the values."""

    @property
    def radius(self) -> float:
        """World unit."""
        return float(self.values[2])

    @property
    def sigma_radius(self) -> float:
        """World unit."""
        return float(np.sqrt(self.covariance[2, 2]))

    @property
    def axis_point_world(self) -> FloatArray:
        """(3,) the point of the axis at the origin's level."""
        return self.origin + self.values[:2] @ self.axes[:2]

    @property
    def axis_world(self) -> FloatArray:
        """(3,) unit vector along the axis, upwards."""
        along = self.axes[2] + self.values[3:] @ self.axes[:2]
        return along / np.linalg.norm(along)

    def unrolled(self, points_world: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(N,) angles about the axis from the first level axis on, counter-clockwise from above, radians; (N,) heights
        above the origin's level; and (N,) level distances from the surface, negative inside. World unit.
        """
        local = (points_world - self.origin) @ self.axes.T
        across = local[:, :2] - self.values[:2] - local[:, 2:] * self.values[3:]
        return np.arctan2(across[:, 1], across[:, 0]), local[:, 2], np.linalg.norm(across, axis=1) - self.radius


@dataclass(frozen=True)
class CurvedWall:
    """A wall that is a cylinder, and why."""

    instance: int
    """Its index in the layout."""
    cylinder: Cylinder
    arc_rad: tuple[float, float]
    """Between which angles its evidence lies, as ``Cylinder.unrolled`` counts; the second is larger, also beyond π."""
    height: tuple[float, float]
    """Between which heights above the origin's level."""
    concave: bool
    """Whether cameras see it from within, as that of a bay; a column is seen from outside."""
    gain_tracks: float
    """By how much its tracks are likelier on the cylinder than on the best plane, as a negative log-likelihood …"""
    gain_edges: float
    """… and its foot and head."""
