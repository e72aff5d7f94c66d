"""The cylinder of a wall as a small factor graph: its tracks, its feet, and the floors and ceilings they lie on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import C, P

from gtlayout.curved.config import CurvedConfig
from gtlayout.curved.evidence import Foot, WallEvidence
from gtlayout.curved.profile import Profile
from gtlayout.cylinder import Cylinder
from gtlayout.factors import cylinder_edge_factor, cylinder_track_factor, plane_prior_factor
from gtlayout.instances import Plane
from gtlayout.scene import FloatArray

_UNKNOWN = 1e3
"""σ of what has no prior, in the local unit."""
_LEAST_VARIANCE = 1e-12
"""Of a plane that is known exactly: a covariance must be positive."""


def fit(
    evidence: WallEvidence,
    planes: Sequence[Plane],
    profile: Profile,
    origin: FloatArray,
    axes: FloatArray,
    unit: float,
    config: CurvedConfig,
) -> Cylinder:
    """The cylinder that fits best from ``profile`` on, with its covariance, in the frame of ``axes`` (3, 3).

    Floors and ceilings are variables with their solved covariance as prior. Each round weighs the errors by a Student t
    distribution, so that a track on a lamp has no say.
    """
    local = _Local(evidence, planes, origin, axes, unit, config)
    values = local.start(np.array([*profile.center / unit, profile.radius / unit, 0.0, 0.0]))
    for _ in range(config.rounds):
        graph, chi2 = local.graph(values)
        values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    graph, chi2 = local.graph(values)
    found = values.atVector(C(0))
    scale = np.array([unit, unit, unit, 1.0, 1.0])
    covariance = max(1.0, chi2) * gtsam.Marginals(graph, values).marginalCovariance(C(0))
    # Errors of the cameras, which many tracks share, move the wall along the view, and bend it by as much.
    shared = config.own_depth_sigma * np.median(evidence.depth) / unit * np.array([1.0, 1.0, 1.0, 0.0, 0.0])
    return Cylinder(origin, axes, scale * found, np.outer(scale, scale) * (covariance + np.diag(shared**2)))


class _Local:
    """The evidence in a world with the wall at its origin and lengths near 1."""

    def __init__(
        self,
        evidence: WallEvidence,
        planes: Sequence[Plane],
        origin: FloatArray,
        axes: FloatArray,
        unit: float,
        config: CurvedConfig,
    ) -> None:
        self.axes, self.origin, self.unit, self.config = axes, origin, unit, config
        self.points = (evidence.points - origin) / unit
        self.rays, self.weight = evidence.rays, evidence.weights(config.fitted_track_weight)
        self.sigma_depth = np.hypot(evidence.sigma_depth, config.own_depth_sigma * evidence.depth) / unit
        self.feet = evidence.feet
        self.planes = {level: planes[level] for level in sorted({foot.level for foot in evidence.feet})}

    def start(self, cylinder: FloatArray) -> gtsam.Values:
        values = gtsam.Values()
        values.insert(C(0), cylinder)
        for level, plane in self.planes.items():
            values.insert(P(level), gtsam.OrientedPlane3(self._coefficients(plane)))
        return values

    def graph(self, values: gtsam.Values) -> tuple[gtsam.NonlinearFactorGraph, float]:
        """The graph with the weights that errors have at ``values``, and their mean square in σ."""
        graph = gtsam.NonlinearFactorGraph()
        lean = self.config.sigma_lean
        free = gtsam.noiseModel.Diagonal.Sigmas(np.array([_UNKNOWN, _UNKNOWN, _UNKNOWN, lean, lean]))
        graph.add(gtsam.PriorFactorVector(C(0), np.zeros(5), free))
        for level, plane in self.planes.items():
            graph.add(plane_prior_factor(P(level), self._coefficients(plane), self._noise(plane)))
        zero = np.zeros(3)
        outwards = self._outwards(values, self.points)
        sigma = np.hypot(self.sigma_depth * np.sum(self.rays @ self.axes[:2].T * outwards, 1), self.config.sigma_relief)
        squares, weights = [], []

        def weighed(make: Callable[[Any], gtsam.CustomFactor], sigma: FloatArray, weight: FloatArray) -> None:
            off = make(gtsam.noiseModel.Unit.Create(len(sigma))).unwhitenedError(values)
            z = off / sigma
            counts = weight * (self.config.freedom + 1) / (self.config.freedom + z**2)
            graph.add(make(gtsam.noiseModel.Diagonal.Sigmas(sigma / np.sqrt(counts))))
            squares.append(counts * z**2)
            weights.append(weight)

        weighed(lambda noise: cylinder_track_factor(C(0), zero, self.axes, self.points, noise), sigma, self.weight)
        for foot in self.feet:
            weighed(self._factor_of(foot), self._sigma(foot, values), np.full(len(foot.rays), self._share(foot)))
        return graph, float(np.concatenate(squares).sum() / np.concatenate(weights).sum())

    def _factor_of(self, foot: Foot) -> Callable[[Any], gtsam.CustomFactor]:
        centers = np.broadcast_to((foot.center - self.origin) / self.unit, foot.rays.shape)
        keys = C(0), P(foot.level)
        return lambda noise: cylinder_edge_factor(keys, np.zeros(3), self.axes, centers, foot.rays, noise)

    def _share(self, foot: Foot) -> float:
        return self.config.edge_weight / len(foot.rays)

    def _sigma(self, foot: Foot, values: gtsam.Values) -> FloatArray:
        """(n,) σ of the level distances of a foot's points."""
        outwards = self._outwards(values, (foot.points - self.origin) / self.unit)
        moved = np.einsum("nkw,lw,nl->nk", foot.by_px / self.unit, self.axes[:2], outwards)
        return np.hypot(foot.sigma_px * np.linalg.norm(moved, axis=1), self.config.sigma_relief)

    def _outwards(self, values: gtsam.Values, points: FloatArray) -> FloatArray:
        """(N, 2) level unit vectors from the axis through points."""
        across = points @ self.axes[:2].T - values.atVector(C(0))[:2]
        return across / np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]

    def _coefficients(self, plane: Plane) -> FloatArray:
        return np.append(plane.normal, (plane.normal @ self.origin + plane.d) / self.unit)

    def _noise(self, plane: Plane) -> Any:
        """Of (turns of the normal, offset at the origin)."""
        by = np.zeros((3, 4))
        by[:2, :3] = gtsam.Unit3(plane.normal).basis().T
        by[2] = np.append(self.origin - plane.anchor, 1.0) / self.unit
        return gtsam.noiseModel.Gaussian.Covariance(by @ plane.covariance @ by.T + _LEAST_VARIANCE * np.eye(3))
