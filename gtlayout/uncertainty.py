"""Stage 4, around the solve: how far each plane may be off, with the scale of all errors taken from their residuals.

Points of one surface seen from one key frame are off together: by errors of cameras, by drift of tracks, by relief. No
number of them averages that out. So every key frame is given its own copy of a surface, a relative error of depth that
varies linearly over it, and the surface one more that all its key frames share. How large those errors are, and how far
annotated edges lie from where planes meet, is estimated on the linearised graph by expectation maximisation of Student
t scales: in a clean scene σ is small, in a poor one large, without anybody telling.

Reference for the scales: Lange, Little, Taylor, "Robust statistical modeling using the t distribution", JASA 1989.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, P, S

from gtlayout.config import EstimationConfig, UncertaintyConfig
from gtlayout.evidence import Evidence, Views
from gtlayout.factors import biased_depth_factor
from gtlayout.instances import HeldBy
from gtlayout.scene import FloatArray, IntArray
from gtlayout.structure import edge_factors, joint_factors, plane_priors
from gtlayout.tracking.tracks import Tracks

TRACK, SURFACE, EDGE, JOINT, PRIOR = range(5)
"""Families of errors: the first three have a scale that is estimated, the others σ as configured; priors are not
measurements, so none of them can be wrong.
"""
_KINDS: dict[HeldBy, int] = {"right angles": JOINT, "contact edges": EDGE, "tracks": TRACK}
"""What may hold a plane, weakest first."""
_KNOWN = 0.5
"""A plane whose σ is more than this share of what priors alone leave is unknown."""
_CLEARLY = 2.0
"""A weaker kind holds a plane when its loss would hurt so many times as much as that of the next stronger one."""


@dataclass(frozen=True)
class Uncertainty:
    """What the marginals say once the noise is known."""

    covariance: FloatArray
    """(4S, 4S) of all planes' (normal, d) together, local world; NaN for those without a plane."""
    held_by: tuple[HeldBy, ...]
    """What each plane rests on; empty for those without a plane."""


@dataclass(frozen=True)
class Scales:
    """How large errors are, in units of what was expected."""

    surface: float
    """Errors of depth that points of a surface share."""
    edge: float
    """Errors of annotated edges."""


@dataclass(frozen=True)
class _Linear:
    """The whitened linear system at the solution: R rows, N unknowns of which the planes' tangents come first."""

    jacobian: FloatArray
    """(R, N)."""
    target: FloatArray
    """(R,) what ``jacobian @ step`` should be."""
    family: IntArray
    """(G,) of each measurement."""
    first: IntArray
    """(G,) its first row: its rows are right or wrong together."""


@dataclass
class _System:
    """A graph in the making, with the family of each measurement."""

    graph: gtsam.NonlinearFactorGraph = field(default_factory=gtsam.NonlinearFactorGraph)
    values: gtsam.Values = field(default_factory=gtsam.Values)
    ordering: gtsam.Ordering = field(default_factory=gtsam.Ordering)
    family: list[int] = field(default_factory=list)
    size: list[int] = field(default_factory=list)

    def insert(self, key: int, start: FloatArray) -> None:
        self.values.insert(key, start)
        self.ordering.push_back(key)

    def add(self, factors: Iterable[gtsam.NonlinearFactor], family: int) -> None:
        for factor in factors:
            self.graph.push_back(factor)
            # Tracks fail one by one, though a factor holds many.
            sizes = [1] * factor.dim() if family == TRACK else [factor.dim()]
            self.size.extend(sizes)
            self.family.extend([family] * len(sizes))

    def linearise(self) -> _Linear:
        jacobian, target = self.graph.linearize(self.values).jacobian(self.ordering)
        first = np.cumsum([0, *self.size[:-1]])
        return _Linear(jacobian, target, np.array(self.family), first)


def error_scales(tracks: Tracks, evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> Scales:
    """How large the residuals at (S, 4) ``planes`` say errors are."""
    placed = np.nonzero(np.isfinite(planes[:, 0]))[0]
    _, scale, _ = _scales(_linearise(tracks, evidence, planes, placed, config), config.uncertainty)
    return Scales(float(scale[SURFACE]), float(scale[EDGE]))


def plane_uncertainty(tracks: Tracks, evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> Uncertainty:
    """Covariance of all planes at the solution ``planes`` (S, 4), with errors as large as the residuals show."""
    placed = np.nonzero(np.isfinite(planes[:, 0]))[0]
    linear = _linearise(tracks, evidence, planes, placed, config)
    covariance, _, row_weight = _scales(linear, config.uncertainty)
    tangents = config.uncertainty.unseen**2 * covariance[: 3 * len(placed), : 3 * len(placed)]
    to_coefficients = np.zeros((4 * len(planes), 3 * len(placed)))
    for i, s in enumerate(placed):
        to_coefficients[4 * s : 4 * s + 3, 3 * i : 3 * i + 2] = gtsam.OrientedPlane3(planes[s]).normal().basis()
        to_coefficients[4 * s + 3, 3 * i + 2] = 1.0
    of_planes = to_coefficients @ tangents @ to_coefficients.T
    absent = np.repeat(~np.isin(np.arange(len(planes)), placed), 4)
    of_planes[absent] = of_planes[:, absent] = np.nan
    held: list[HeldBy] = [""] * len(planes)
    by_offset = np.array([_by_offset(planes[s], evidence.views[s]) for s in placed])
    for s, kind in zip(placed, _held_by(linear, row_weight, by_offset), strict=True):
        held[s] = kind
    # What joins a door or window to others is its wall, not an angle.
    of_wall = (evidence.host >= 0) & np.array([kind == "right angles" for kind in held])
    held = [held[evidence.host[s]] if of_wall[s] else held[s] for s in range(len(held))]
    return Uncertainty(of_planes, tuple(held))


def _linearise(
    tracks: Tracks, evidence: Evidence, planes: FloatArray, placed: IntArray, config: EstimationConfig
) -> _Linear:
    """Tracks without their landmarks, the biases of surfaces and key frames, and all that joins planes."""
    system = _System()
    for s in placed.tolist():
        system.values.insert(P(s), gtsam.OrientedPlane3(planes[s]))
        system.ordering.push_back(P(s))
    for s in placed.tolist():
        _add_tracks(system, tracks, evidence, s, planes[s], config)
    # Robust weights are for the scales to decide.
    quadratic = replace(config, edge_cauchy=np.inf, coplanarity_cauchy=np.inf, right_angle_cauchy=np.inf)
    system.add(edge_factors(evidence, planes, quadratic), EDGE)
    system.add(joint_factors(evidence, planes, quadratic), JOINT)
    system.add(plane_priors(evidence, planes, config.sigma_prior_depths, config), PRIOR)
    return system.linearise()


def _add_tracks(
    system: _System, tracks: Tracks, evidence: Evidence, s: int, plane: FloatArray, config: EstimationConfig
) -> None:
    """What the tracks of surface ``s`` say of its plane, and how far they may be off together."""
    expected = config.uncertainty
    index = np.nonzero((evidence.track_surface == s) & (evidence.track_weight > 0))[0]
    points, depth = evidence.on_planes(index, plane)
    index, points, depth = index[depth > 0], points[depth > 0], depth[depth > 0]
    if len(index) == 0:
        return
    # Surfaces of which few points survive (mirrors, gloss) are off by more.
    trust = np.sqrt(max(float(evidence.track_weight[index].max()), expected.least_trust))
    over = np.column_stack([np.ones(len(index)), _across(points, plane)])
    rays = evidence.rays
    raw = rays.sigma_rho[index] * depth
    # Observations of a track share errors: it knows no more than so many of them would.
    observations = np.bincount(tracks.track, minlength=len(tracks))[index]
    sigma = raw * np.sqrt(np.maximum(observations / config.independent_observations, 1.0))
    sigma = np.hypot(sigma, config.sigma_surface / np.median(depth))
    point, isotropic = np.zeros(3), gtsam.noiseModel.Isotropic.Sigma
    shared = isotropic(3, expected.shared_share * expected.relative_depth / trust)
    system.insert(S(s), point)
    system.add([gtsam.PriorFactorPoint3(S(s), point, shared)], SURFACE)
    key_frame = evidence.track_key_frame[index]
    for k in np.unique(key_frame).tolist():
        here = key_frame == k
        key = B(s * len(tracks.tried) + k)
        bias = np.hypot(expected.relative_depth, expected.of_track * np.median(raw[here]))
        system.insert(key, point)
        system.add([gtsam.BetweenFactorPoint3(S(s), key, point, isotropic(3, bias / trust))], SURFACE)
        members, per_depth = index[here], 1 / depth[here]
        factor = biased_depth_factor(
            (P(s), key),
            rays.center[members],
            rays.ray[members],
            rays.rho[members],
            over[here] * per_depth[:, None],
            gtsam.noiseModel.Diagonal.Sigmas(sigma[here] * per_depth),
        )
        system.add([factor], TRACK)


def _across(points: FloatArray, plane: FloatArray) -> FloatArray:
    """(n, 2) where points lie on a plane, from their middle, in units of their spread."""
    uv = (points - np.median(points, axis=0)) @ gtsam.Unit3(plane[:3]).basis()
    return uv / max(float(np.sqrt(np.mean(np.sum(uv**2, axis=1)))), 1e-9)


def _by_offset(plane: FloatArray, views: Views) -> FloatArray:
    """(3,) derivative, by the tangent, of a plane's offset amid what is drawn of it."""
    points, _ = views.seen_on(plane)
    middle = np.median(points, axis=0) if len(points) else -plane[3] * plane[:3]
    return np.append(middle @ gtsam.OrientedPlane3(plane).normal().basis(), 1.0)


def _held_by(linear: _Linear, row_weight: FloatArray, by_offset: FloatArray) -> list[HeldBy]:
    """Of each of P planes the weakest kind of evidence without which it is unknown, else what it would miss most.

    Args:
        row_weight: (R,) weights of the rows.
        by_offset: (P, 3) derivative of each plane's offset by its tangent.
    """
    width = by_offset.size
    family = np.repeat(linear.family, np.diff(np.append(linear.first, len(linear.target))))
    rows = np.sqrt(row_weight)[:, None] * linear.jacobian
    tracked = np.isin(family, [TRACK, SURFACE])
    information = rows[tracked].T @ rows[tracked]
    by_bias = information[:width, width:]
    # Without its biases, what tracks say is of one plane each: blocks on the diagonal.
    tracks = information[:width, :width] - by_bias @ np.linalg.solve(information[width:, width:], by_bias.T)
    others, other_family = rows[~tracked, :width], family[~tracked]

    def sigmas(i: int, *dropped: int) -> FloatArray:
        """(2,) of the normal, radians, and of the offset, without these families' measurements of plane ``i``."""
        own = slice(3 * i, 3 * i + 3)
        kept = others[~(np.isin(other_family, dropped) & others[:, own].any(axis=1))]
        of_tracks = tracks.copy()
        if TRACK in dropped:
            of_tracks[own] = 0.0
        covariance = np.linalg.inv(of_tracks + kept.T @ kept)[own, own]
        offset = by_offset[i] @ covariance @ by_offset[i]
        return np.sqrt(np.array([np.linalg.eigvalsh(covariance[:2, :2])[-1], offset]))

    held: list[HeldBy] = []
    for i in range(len(by_offset)):
        unknown = _KNOWN * sigmas(i, *_KINDS.values())
        best = sigmas(i)
        without = {kind: sigmas(i, dropped) for kind, dropped in _KINDS.items()}
        needed = [kind for kind in _KINDS if (without[kind] > unknown).any()]
        hurts = [float((without[kind] / best).max()) * _CLEARLY**rank for rank, kind in enumerate(_KINDS)]
        missed = list(_KINDS)[int(np.argmax(hurts))]
        held.append("priors" if (best > unknown).any() else [*needed, missed][0])
    return held


def _scales(linear: _Linear, config: UncertaintyConfig) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(N, N) covariance at the estimated scales, (5,) these scales by family, and the (R,) weights it was made with.

    Iterates between the unknowns with their covariance, the weight of each measurement (Student t), and the scales.
    """
    size = np.diff(np.append(linear.first, len(linear.target)))
    scale = np.ones(5)
    weight = np.ones(len(size))
    covariance: FloatArray = np.eye(linear.jacobian.shape[1])
    for _ in range(config.rounds):
        row_weight = np.repeat(weight / scale[linear.family] ** 2, size)
        weighted = np.sqrt(row_weight)[:, None] * linear.jacobian
        covariance = np.asarray(np.linalg.inv(weighted.T @ weighted))
        step = covariance @ (linear.jacobian.T @ (row_weight * linear.target))
        residual = linear.jacobian @ step - linear.target
        # Residuals are smaller than errors by what the unknowns could absorb.
        absorbed = np.sum((linear.jacobian @ covariance) * linear.jacobian, axis=1)
        error = np.add.reduceat(residual**2, linear.first)
        expected = error + np.add.reduceat(absorbed, linear.first)
        freedom = config.student_freedom
        robust = linear.family != PRIOR
        weight = np.where(robust, (freedom + size) / (freedom + error / scale[linear.family] ** 2), 1.0)
        for family in (TRACK, SURFACE, EDGE):
            own = linear.family == family
            measured = np.sum(weight[own] * expected[own]) + config.prior_measurements
            scale[family] = np.sqrt(measured / (np.sum(size[own]) + config.prior_measurements))
    return covariance, scale, row_weight
