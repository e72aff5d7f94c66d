"""An upright cylinder with its covariance: plain data."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
    def sigma_normal_deg(self) -> float:
        """σ of the direction of its normals, degrees: of the axis's lean, or of where the axis is, by the radius."""
        turn = self.covariance[:2, :2] / self.radius**2
        largest = max(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1], np.linalg.eigvalsh(turn)[-1])
        return float(np.rad2deg(np.sqrt(largest)))

    @property
    def axis_point_world(self) -> FloatArray:
        """(3,) the point of the axis at the origin's level."""
        return self.origin + self.values[:2] @ self.axes[:2]

    @property
    def axis_world(self) -> FloatArray:
        """(3,) unit vector along the axis, upwards."""
        along = self.axes[2] + self.values[3:] @ self.axes[:2]
        return along / np.linalg.norm(along)

    def points(self, angles: FloatArray, heights: FloatArray) -> FloatArray:
        """(N, 3) world points of the surface: the inverse of ``unrolled``."""
        outwards = np.column_stack([np.cos(angles), np.sin(angles)])
        across = self.values[:2] + self.radius * outwards + heights[:, None] * self.values[3:]
        return self.origin + across @ self.axes[:2] + heights[:, None] * self.axes[2]

    def sigma_offset(self, points_world: FloatArray) -> FloatArray:
        """(N,) σ of the surface's position along its normal at (N, 3) points on it, world unit."""
        angles, heights, _ = self.unrolled(points_world)
        outwards = np.column_stack([np.cos(angles), np.sin(angles)])
        gradient = np.column_stack([outwards, np.ones(len(angles)), heights[:, None] * outwards])
        variance = np.einsum("na,ab,nb->n", gradient, self.covariance, gradient)
        return np.sqrt(np.maximum(variance, 0.0))

    def turned(self, rotation: FloatArray) -> Cylinder:
        """In a world turned by a (3, 3) rotation."""
        return replace(self, origin=rotation @ self.origin, axes=self.axes @ rotation.T)

    def scaled(self, factor: float) -> Cylinder:
        """In a world whose unit is smaller by ``factor``."""
        by = np.array([factor, factor, factor, 1.0, 1.0])
        return replace(
            self, origin=factor * self.origin, values=by * self.values, covariance=np.outer(by, by) * self.covariance
        )

    def moved(self, by: FloatArray) -> Cylinder:
        """In a world whose origin lies at -``by``, (3,)."""
        return replace(self, origin=self.origin + by)

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

    def scaled(self, factor: float) -> CurvedWall:
        """In a world whose unit is smaller by ``factor``."""
        low, high = self.height
        return replace(self, cylinder=self.cylinder.scaled(factor), height=(factor * low, factor * high))
