"""Stage 4, around the solve: the uncertainty of each plane, with the scale of all errors estimated from the residuals.

Points of one instance seen from one key frame share errors: of cameras, of drifting tracks, of relief. No number of
points averages these out. So every key frame has its own relative error of depth for an instance, which varies linearly
over its plane, and the instance has one more that all its key frames share. The scales of these errors, and of the
errors of annotated edges, are estimated on the linearised graph by expectation maximisation of Student t scales. So σ
is small in a clean scene and large in a poor one.

Reference for the scales: Lange, Little, Taylor, "Robust statistical modeling using the t distribution", JASA 1989.
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from gtlayout.geometry.rays import nonzero
from gtlayout.instances import EvidenceKind
from gtlayout.planes.arrow import by_blocks, eliminate, inverse, solve
from gtlayout.planes.config import EstimationConfig, UncertaintyConfig
from gtlayout.planes.dominant_evidence import dominant_evidence, middle_on, offset_gradient
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.evidence_alone import evidence_alone
from gtlayout.planes.linear_system import ANGLE, EDGE, OFFSET, PRIOR, SHARED_DEPTH, TRACK, LinearSystem
from gtlayout.planes.linearisation import linearise
from gtlayout.planes.trail import PlaneTrail
from gtlayout.scene import BoolArray, FloatArray
from gtlayout.tracking.tracks import Tracks


@dataclass(frozen=True)
class Uncertainty:
    """The marginals of all planes at the estimated noise."""

    covariance: FloatArray
    """(4S, 4S) of all planes' (normal, d) together, local world; NaN for those without a plane."""
    dominant_evidence: tuple[EvidenceKind, ...]
    """The kind of evidence that each plane rests on; empty for those without a plane."""
    trails: tuple[PlaneTrail, ...]
    """What each kind of evidence says of each plane by itself, local world."""


@dataclass(frozen=True)
class Scales:
    """The scale of errors, as a multiple of the expected one."""

    shared_depth: float
    """Errors of depth that points of an instance share."""
    edge: float
    """Errors of annotated edges."""
    offset: float
    angle: float
    """Deviations from right angles."""
    """How far drawn lines lie from where planes meet."""


def error_scales(tracks: Tracks, evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> Scales:
    """The scale of errors from the residuals at (S, 4) ``planes``."""
    placed = np.nonzero(np.isfinite(planes[:, 0]))[0]
    _, scale, _ = robust_scales(linearise(tracks, evidence, planes, placed, config), config.uncertainty)
    return Scales(float(scale[SHARED_DEPTH]), float(scale[EDGE]), float(scale[OFFSET]), float(scale[ANGLE]))


def plane_uncertainty(tracks: Tracks, evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> Uncertainty:
    """Covariance of all planes at the solution ``planes`` (S, 4), with errors as large as the residuals show."""
    placed = np.nonzero(np.isfinite(planes[:, 0]))[0]
    linear = linearise(tracks, evidence, planes, placed, config)
    covariance, scale, row_weight = robust_scales(linear, config.uncertainty)
    elimination = eliminate(linear.rows.tree, linear.rows.information(row_weight))
    camera_errors = _camera_errors(linear, evidence, planes)
    by_cameras = np.empty((3 * len(placed), camera_errors.shape[1]))
    for way, error in enumerate(camera_errors.T):
        by_cameras[:, way] = solve(elimination, linear.rows.gradient(row_weight * error))[: len(placed)].ravel()
    tangents = covariance + by_cameras @ by_cameras.T
    # The solve weighs tracks and edges in another way than the noise estimated here would. Where that makes a
    # difference, it is one more error, of each plane by itself; at most as large as the others: either may be right.
    own = np.arange(len(placed))
    step = solve(elimination, linear.rows.gradient(row_weight * linear.target))[: len(placed)]
    blocks = by_blocks(tangents)
    squared = np.einsum("pi,pi->p", step, np.linalg.solve(blocks[own, :, own], step[:, :, None])[:, :, 0])
    step /= np.sqrt(np.maximum(squared, 1.0))[:, None]
    blocks[own, :, own] += step[:, :, None] * step[:, None]
    to_coefficients = np.zeros((4 * len(planes), 3 * len(placed)))
    for i, s in enumerate(placed):
        to_coefficients[4 * s : 4 * s + 3, 3 * i : 3 * i + 2] = gtsam.OrientedPlane3(planes[s]).normal().basis()
        to_coefficients[4 * s + 3, 3 * i + 2] = 1.0
    of_planes = to_coefficients @ tangents @ to_coefficients.T
    absent = np.repeat(~np.isin(np.arange(len(planes)), placed), 4)
    of_planes[absent] = of_planes[:, absent] = np.nan
    held: list[EvidenceKind] = [""] * len(planes)
    by_offset = np.array([offset_gradient(planes[s], evidence.views[s]) for s in placed])
    for s, kind in zip(placed, dominant_evidence(linear, row_weight, by_offset), strict=True):
        held[s] = kind
    trails = [PlaneTrail(np.full(3, np.nan), ()) for _ in planes]
    alone = evidence_alone(linear, scale, tangents, camera_errors, by_offset, config.uncertainty)
    for s, said in zip(placed, alone, strict=True):
        trails[s] = PlaneTrail(middle_on(planes[s], evidence.views[s]), said)
    # A door or window is joined to others by its wall, not by an angle.
    of_wall = (evidence.host >= 0) & np.array([kind == "right angles" for kind in held])
    held = [held[evidence.host[s]] if of_wall[s] else held[s] for s in range(len(held))]
    return Uncertainty(of_planes, tuple(held), tuple(trails))


def _camera_errors(linear: LinearSystem, evidence: Evidence, planes: FloatArray) -> FloatArray:
    """(R, Q) what each way in which the cameras may be wrong adds to the rows' target, by one σ."""
    response = evidence.camera_response
    rows = np.nonzero(linear.track >= 0)[0]
    track = linear.track[rows]
    plane, key_frame = planes[evidence.track_instance[track]], evidence.track_key_frame[track]
    ray, center = evidence.rays.ray[track], evidence.rays.center[track]
    facing = np.sum(plane[:, :3] * ray, axis=1)
    clearance = nonzero(np.sum(plane[:, :3] * center, axis=1) + plane[:, 3])
    # The residual is ρ + n · v / (n · c + d), for the ray v and the centre c of the key frame's camera.
    by_turn = np.cross(ray, plane[:, :3]) / clearance[:, None]
    by_center = -(facing / clearance**2)[:, None] * plane[:, :3]
    change = evidence.rays.rho[track, None] * response.rho_share[track]
    change += np.einsum("ri,rqi->rq", by_turn, response.turn[key_frame])
    change += np.einsum("ri,rqi->rq", by_center, response.center[key_frame])
    errors = np.zeros((len(linear.target), response.rho_share.shape[1]))
    errors[rows] = -change / linear.sigma_rho[rows, None]
    return errors


def robust_scales(
    linear: LinearSystem, config: UncertaintyConfig, used: BoolArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(3P, 3P) covariance of the planes at the estimated scales, (7,) these scales by family, and the (R,) weights it
    was made with.

    Iterates between the unknowns with their covariance, the weight of each measurement (Student t), and the scales. The
    scales are one update newer than the covariance and its weights. Of the G measurements those not ``used`` have no
    weight; all are when not given.
    """
    rows, size = linear.rows, linear.size
    scale = np.ones(7)
    counted = np.ones(len(size)) if used is None else used.astype(np.float64)
    weight = counted
    for _ in range(config.rounds):
        row_weight = np.repeat(weight / scale[linear.family] ** 2, size)
        elimination = eliminate(rows.tree, rows.information(row_weight))
        covariance = inverse(elimination)
        residual = rows.times(solve(elimination, rows.gradient(row_weight * linear.target))) - linear.target
        # Residuals are smaller than errors, because the unknowns absorb a part.
        absorbed = rows.variances(covariance)
        error = np.add.reduceat(residual**2, linear.first)
        expected = error + np.add.reduceat(absorbed, linear.first)
        freedom = config.student_freedom
        robust = linear.family != PRIOR
        weight = counted * np.where(robust, (freedom + size) / (freedom + error / scale[linear.family] ** 2), 1.0)
        for family in (TRACK, SHARED_DEPTH, EDGE, OFFSET, ANGLE):
            own = (linear.family == family) & (counted > 0)
            if not own.any():
                continue
            measured = np.sum(weight[own] * expected[own]) + config.prior_measurements
            scale[family] = np.sqrt(measured / (np.sum(size[own]) + config.prior_measurements))
    return covariance.root, scale, row_weight
