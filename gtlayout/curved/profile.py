"""A wall seen from above: is it a line or an arc? Both are fitted to the same evidence, and weighed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from gtlayout.curved.config import CurvedConfig
from gtlayout.curved.evidence import WallEvidence
from gtlayout.scene import FloatArray

Curve = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""(variables, (N, 2) points) → (N,) distances from the curve, and (N, 2) unit vectors along which they grow."""
_DIRECTIONS = 6
"""Lines in so many directions, and arcs on both sides of the best one, are tried."""
_TRIED, _POLISHED = 40, 200
"""Evaluations from each start, and from the best: on a flat wall the radius grows without end."""
_RADII = (0.7, 2.0)


@dataclass(frozen=True)
class Profile:
    """The arc that fits best, against the best line. World unit."""

    center: FloatArray
    """(2,) in the level frame."""
    radius: float
    gain_tracks: float
    gain_edges: float
    bent_feet: float
    """Share of the feet that are likelier on the arc, and no line in their own image; 0 without feet."""
    price: float
    """Of the third variable: half the logarithm of the number of measurements (BIC)."""


def profile_of(
    evidence: WallEvidence,
    origin: FloatArray,
    axes: FloatArray,
    unit: float,
    config: CurvedConfig,
    least: float = 0.0,
    least_each: float = -np.inf,
) -> Profile | None:
    """Fit a line and an arc to what shows a wall, in the frame of two level ``axes`` (2, 3) through ``origin`` (3,).

    None where no arc can gain so much as is asked at ``least``, in all or by tracks and feet ``each``: it gains at most
    what the line costs. So most flat walls need no arc.
    """
    level = _Level(evidence, origin, axes, unit, config)
    turns = np.linspace(0, np.pi, _DIRECTIONS, endpoint=False)
    normals = np.column_stack([np.cos(turns), np.sin(turns)])
    line = level.best(_line, [np.array([t, np.median(level.points @ n)]) for t, n in zip(turns, normals, strict=True)])
    on_line, foot_line = level.costs(_line, line)
    if on_line + foot_line <= least or min(on_line, foot_line) <= least_each:
        return None
    normal = np.array([np.cos(line[0]), np.sin(line[0])])
    arcs = [
        np.append(line[1] * normal + side * radius * unit * normal, np.log(radius * unit))
        for side in (-1, 1)
        for radius in _RADII
    ]
    arc = level.best(_arc, arcs)
    on_arc, foot_arc = level.costs(_arc, arc)
    measurements = level.weight.sum() + config.edge_weight * len(evidence.feet)
    price = 0.5 * float(np.log(max(measurements, 1.0)))
    # Straight feet beside each other, where a plane or the floor is wrong, are likelier on an arc, too.
    own = np.array([foot.bend_px > config.straight_foot * foot.sigma_px for foot in evidence.feet], dtype=bool)
    likelier = level.foot_costs(_arc, arc) < level.foot_costs(_line, line) if evidence.feet else own
    bent = float(np.mean(likelier & own)) if evidence.feet else 0.0
    return Profile(arc[:2], float(np.exp(arc[2])), on_line - on_arc, foot_line - foot_arc, bent, price)


class _Level:
    """The evidence in the level frame."""

    def __init__(
        self, evidence: WallEvidence, origin: FloatArray, axes: FloatArray, unit: float, config: CurvedConfig
    ) -> None:
        self.points = (evidence.points - origin) @ axes.T
        self.rays = evidence.rays @ axes.T
        self.sigma_depth = np.hypot(evidence.sigma_depth, config.shared_depth_sigma * evidence.depth)
        self.weight = evidence.weights(config.judged_track_weight)
        self.feet = [((foot.points - origin) @ axes.T, foot.by_px @ axes.T, foot.sigma_px) for foot in evidence.feet]
        self.relief, self.freedom, self.edge_weight = config.sigma_relief * unit, config.freedom, config.edge_weight

    def best(self, curve: Curve, starts: Sequence[FloatArray]) -> FloatArray:
        """The variables of the curve that costs least."""

        def residuals(variables: FloatArray) -> FloatArray:
            return self._residuals(curve, variables)

        found = [least_squares(residuals, start, method="lm", max_nfev=_TRIED).x for start in starts]
        # Rounded, so that of starts that end in one place the first is taken.
        best = found[int(np.argmin([round(sum(self.costs(curve, x)), 6) for x in found]))]
        return least_squares(residuals, best, method="lm", max_nfev=_POLISHED).x

    def costs(self, curve: Curve, variables: FloatArray) -> tuple[float, float]:
        """Negative log-likelihoods of the tracks, and of feet and heads."""
        half = 0.5 * self._residuals(curve, variables) ** 2
        return float(half[: len(self.points)].sum()), float(half[len(self.points) :].sum())

    def foot_costs(self, curve: Curve, variables: FloatArray) -> FloatArray:
        """(F,) negative log-likelihoods of each foot."""
        half = 0.5 * self._residuals(curve, variables)[len(self.points) :] ** 2
        first = np.cumsum([0, *(len(points) for points, _, _ in self.feet)])[:-1]
        return np.add.reduceat(half, first)

    def _residuals(self, curve: Curve, variables: FloatArray) -> FloatArray:
        """Whose half squares are the negative log-likelihoods of a Student t distribution, weighted."""
        off, outwards = curve(variables, self.points)
        parts = [off / np.hypot(self.sigma_depth * np.sum(self.rays * outwards, axis=1), self.relief)]
        weights = [self.weight]
        for points, by_px, sigma_px in self.feet:
            off, outwards = curve(variables, points)
            moved = np.linalg.norm(np.einsum("nkc,nc->nk", by_px, outwards), axis=1)
            parts.append(off / np.hypot(sigma_px * moved, self.relief))
            weights.append(np.full(len(points), self.edge_weight / len(points)))
        z, weight = np.concatenate(parts), np.concatenate(weights)
        return np.sign(z) * np.sqrt(weight * (self.freedom + 1) * np.log1p(z**2 / self.freedom))


def _line(variables: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variables: the direction of the normal, and the offset along it."""
    normal = np.array([np.cos(variables[0]), np.sin(variables[0])])
    return points @ normal - variables[1], np.broadcast_to(normal, points.shape)


def _arc(variables: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variables: the centre, and the logarithm of the radius."""
    across = points - variables[:2]
    distance = np.maximum(np.linalg.norm(across, axis=1), 1e-12)
    return distance - np.exp(variables[2]), across / distance[:, None]
