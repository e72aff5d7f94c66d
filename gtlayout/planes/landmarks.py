"""Landmarks and their observations, with each landmark eliminated by its Schur complement.

A landmark is tied to one plane, so what is left of it is information on that plane alone: a graph of any number of
tracks becomes one of planes. All landmarks are linearised and eliminated at once; GTSAM, factor by factor, takes ten
times as long.

Reference: Triggs, McLauchlan, Hartley, Fitzgibbon, "Bundle adjustment – a modern synthesis", 2000, section 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import gtsam
import numpy as np

from gtlayout.planes.arrow import summed
from gtlayout.planes.config import EstimationConfig
from gtlayout.scene import BoolArray, Camera, FloatArray, IntArray
from gtlayout.tracking.tracks import Tracks

_BEHIND_PX = 1e3


@dataclass(frozen=True)
class Landmarks:
    """n landmarks, each with its plane, and their m observations, those of a landmark together."""

    plane: IntArray
    """(n,) instance on whose plane each lies."""
    prior: FloatArray
    """(n, 3) where each starts. One that its own observations contradict could diverge to infinity."""
    sigma_prior: float
    sigma_plane: FloatArray
    """(n,) σ of the distance from the plane: relief of the surface, and little trust in the track."""
    owner: IntArray
    """(m,) landmark of each observation."""
    projection: FloatArray
    """(m, 3, 4) ``K [R | t]``."""
    points_px: FloatArray
    """(m, 2)."""
    sigma_px: FloatArray
    """(m,)."""
    cauchy: float
    """Robust scale of an observation, in σ."""

    @classmethod
    def of(
        cls,
        cameras: Sequence[Camera],
        tracks: Tracks,
        used: IntArray,
        observed: BoolArray,
        plane: IntArray,
        start: FloatArray,
        weight: FloatArray,
        config: EstimationConfig,
    ) -> Self:
        """The landmarks of tracks.

        Args:
            used: (n,) the tracks, in ascending order.
            observed: (M,) the observations that take part, of all tracks.
            plane: (n,) instance of each.
            start: (n, 3) where each starts.
            weight: (n,) weight of each, in (0, 1].
        """
        number = np.full(len(tracks), -1)
        number[used] = np.arange(len(used))
        kept = observed & (number[tracks.track] >= 0)
        owner, frame = number[tracks.track[kept]], tracks.frame[kept]
        shown = np.unique(frame)
        projections = np.array(
            [
                camera.K @ np.column_stack([camera.R_cam_from_world, camera.t_cam_from_world])
                for camera in (cameras[f] for f in shown)
            ]
        ).reshape(-1, 3, 4)
        return cls(
            plane,
            start,
            config.sigma_prior_point,
            config.sigma_relief / np.sqrt(weight),
            owner,
            projections[np.searchsorted(shown, frame)],
            tracks.points_px[kept],
            (tracks.sigma_px[used] / np.sqrt(weight))[owner],
            config.observation_cauchy,
        )

    def error(self, planes: FloatArray, points: FloatArray) -> float:
        """Negative log-likelihood of (n, 3) ``points`` and (S, 4) ``planes``, up to a constant."""
        residual, _ = self._reprojection(points)
        squared = np.sum(residual**2, axis=1)
        own = planes[self.plane]
        distance = (np.sum(own[:, :3] * points, axis=1) + own[:, 3]) / self.sigma_plane
        moved = (points - self.prior) / self.sigma_prior
        robust = self.cauchy**2 * np.log1p(squared / self.cauchy**2)
        return 0.5 * float(robust.sum() + np.sum(distance**2) + np.sum(moved**2))

    def linearise(self, planes: FloatArray, points: FloatArray) -> Linearised:
        """At (S, 4) ``planes`` and (n, 3) ``points``, in the tangents of ``gtsam.OrientedPlane3`` and ``Point3``."""
        residual, by_point = self._reprojection(points)
        weight = 1 / (1 + np.sum(residual**2, axis=1) / self.cauchy**2)
        information = summed(np.einsum("m,mri,mrj->mij", weight, by_point, by_point), self.owner, len(points))
        gradient = -summed(np.einsum("m,mri,mr->mi", weight, by_point, residual), self.owner, len(points))
        own = planes[self.plane]
        normal = own[:, :3] / self.sigma_plane[:, None]
        distance = (np.sum(own[:, :3] * points, axis=1) + own[:, 3]) / self.sigma_plane
        bases = np.zeros((len(planes), 3, 2))
        for s in np.unique(self.plane).tolist():
            bases[s] = gtsam.OrientedPlane3(planes[s]).normal().basis()
        by_plane = np.column_stack([np.einsum("ni,nij->nj", points, bases[self.plane]), np.ones(len(points))])
        information += normal[:, :, None] * normal[:, None] + np.eye(3) / self.sigma_prior**2
        gradient -= distance[:, None] * normal + (points - self.prior) / self.sigma_prior**2
        return Linearised(
            self.plane, len(planes), information, gradient, normal, by_plane / self.sigma_plane[:, None], distance
        )

    def _reprojection(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(m, 2) residuals in σ and their (m, 2, 3) derivatives.

        A point behind its camera is off by the size of an image, and no small step changes that.
        """
        homogeneous = np.einsum("mij,mj->mi", self.projection[:, :, :3], points[self.owner]) + self.projection[:, :, 3]
        depth = homogeneous[:, 2:]
        seen = depth > 0
        depth = np.where(seen, depth, 1.0)
        projected = homogeneous[:, :2] / depth
        residual = np.where(seen, projected - self.points_px, _BEHIND_PX)
        by_point = (self.projection[:, :2, :3] - projected[:, :, None] * self.projection[:, 2:, :3]) / depth[:, :, None]
        by_point = np.where(seen[:, :, None], by_point, 0.0)
        return residual / self.sigma_px[:, None], by_point / self.sigma_px[:, None, None]


@dataclass(frozen=True)
class Linearised:
    """All landmarks linearised: the row that ties each to its plane, and all else, which is of the landmark alone."""

    plane: IntArray
    """(n,)"""
    planes: int
    """S."""
    information: FloatArray
    """(n, 3, 3) of the landmarks, the tie included."""
    gradient: FloatArray
    """(n, 3) towards the optimum, the tie included."""
    normal: FloatArray
    """(n, 3) derivative of the tie by the landmark, whitened."""
    by_plane: FloatArray
    """(n, 3) its derivative by the plane."""
    distance: FloatArray
    """(n,) the tie's residual."""

    def eliminated(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """(S, 3, 3) information and (S, 3) gradient of all planes, without the landmarks."""
        across, ahead = self._solved(damping)
        left = 1 - np.sum(self.normal * across, axis=1)
        pull = -self.distance - np.sum(self.normal * ahead, axis=1)
        information = left[:, None, None] * self.by_plane[:, :, None] * self.by_plane[:, None]
        return summed(information, self.plane, self.planes), summed(
            pull[:, None] * self.by_plane, self.plane, self.planes
        )

    def step(self, damping: float, of_planes: FloatArray) -> FloatArray:
        """(n, 3) steps of the landmarks, for (S, 3) steps of the planes."""
        across, ahead = self._solved(damping)
        return ahead - across * np.sum(self.by_plane * of_planes[self.plane], axis=1)[:, None]

    def _solved(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """(n, 3) the tie's derivative and the gradient, times the damped landmarks' covariance."""
        right = np.stack([self.normal, self.gradient], axis=2)
        solved = np.asarray(np.linalg.solve(self.information + damping * np.eye(3), right), np.float64)
        return solved[:, :, 0], solved[:, :, 1]
