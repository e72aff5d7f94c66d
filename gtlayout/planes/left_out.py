"""After stage 4: where the contacts of a key frame would be, had it not been drawn.

A contact that is drawn in the wrong place pulls the planes towards it, so it lies closer to their line than it should.
Each key frame's contacts are therefore compared with planes solved without them: one more solution of the linearised
system, of planes alone, in which their rows do not count.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from gtlayout.instances import Plane
from gtlayout.planes.arrow import Blocks, eliminate, inverse, solve
from gtlayout.planes.config import EstimationConfig, UncertaintyConfig
from gtlayout.planes.contact_offsets import contact_offsets
from gtlayout.planes.evidence import Evidence, gather
from gtlayout.planes.linear_system import EDGE, PRIOR, LinearSystem
from gtlayout.planes.linearisation import linearise
from gtlayout.planes.structural_factors import met
from gtlayout.planes.uncertainty import robust_scales
from gtlayout.prepared.measurements import Measurements
from gtlayout.scene import BoolArray, FloatArray
from gtlayout.tracking.normalisation import Normalisation

_ROUNDS = 4
"""Re-weightings without a key frame. Most of what is wrong in the others has its low weight after the first."""


@dataclass(frozen=True)
class ExpectedContact:
    """A contact edge of a key frame against the planes as all other drawings have them."""

    key_frame: int
    instances: tuple[int, int]
    drawn_px: FloatArray
    """(N, 2) samples along it, in order."""
    expected_px: FloatArray | None
    """(N, 2) the nearest points of the line in which the planes meet, where that is usually drawn; None for planes that
    nearly coincide as seen from there."""
    distance_px: float
    """Root mean square of their distances, as of an image of 640x480."""
    sigma_px: float
    """σ of the line there, likewise; 0 where there is none."""


def contacts_without_their_key_frame(
    measured: Measurements,
    planes: Sequence[Plane],
    ignored: Collection[tuple[int, int]],
    config: EstimationConfig,
) -> tuple[ExpectedContact, ...]:
    """Every contact edge whose planes are known, against the planes solved without the contacts of its key frame.

    Args:
        measured: What the ``planes`` were solved from.
        planes: One for each instance, in the world of ``measured``.
        ignored: Pairs of instances, the smaller number first, whose contacts had no part in the solve.
    """
    local = Normalisation.of(measured.rays)
    evidence = gather(measured, local, config)
    at = np.array([[*plane.normal, plane.d] if plane.observable else np.full(4, np.nan) for plane in planes])
    at = local.planes(at)
    linear = linearise(measured.tracks, evidence, at, np.nonzero(np.isfinite(at[:, 0]))[0], config)
    edges = [group for group in evidence.edges if np.isfinite(at[list(group.instances), 0]).all()]
    if not edges:
        return ()
    edge_rows = np.nonzero(linear.family == EDGE)[0]
    key_frame = np.array([group.key_frame for group in edges])
    used = np.ones(len(linear.family), dtype=bool)
    used[edge_rows[[group.instances in ignored for group in edges]]] = False
    _, scale, _ = robust_scales(linear, config.uncertainty, used)
    found = []
    for k in np.unique(key_frame).tolist():
        of_others = used.copy()
        of_others[edge_rows[key_frame == k]] = False
        step, covariance = _fit(linear, of_others, scale, config.uncertainty)
        variances = linear.rows.variances(covariance)
        moved, offsets = _moved(evidence, at, step, config)
        for number in np.nonzero(key_frame == k)[0].tolist():
            group, first = edges[number], linear.first[edge_rows[number]]
            misfits_px = group.misfits_px(moved, offsets[group.instances])
            meet = bool(np.isfinite(misfits_px).all())
            sigma = np.array([config.sigma_edge_shift_px, config.sigma_edge_tilt_px])
            found.append(
                ExpectedContact(
                    k,
                    group.instances,
                    group.points_px,
                    group.feet_px(moved, offsets[group.instances]) if meet else None,
                    float(np.sqrt(np.mean(group.annotation_px(misfits_px) ** 2))),
                    float(np.sqrt(np.sum(sigma**2 * variances[first : first + 2]))) if meet else 0.0,
                )
            )
    return tuple(found)


def _fit(
    linear: LinearSystem, used: BoolArray, scale: FloatArray, config: UncertaintyConfig
) -> tuple[FloatArray, Blocks]:
    """(N, 3) unknowns that fit the (G,) ``used`` measurements best, at (7,) scales of errors, and their covariance."""
    size, by_scale = linear.size, scale[linear.family]
    weight: FloatArray = used.astype(np.float64)
    for _ in range(_ROUNDS):
        row_weight = np.repeat(weight / by_scale**2, size)
        elimination = eliminate(linear.rows.tree, linear.rows.information(row_weight))
        unknowns = solve(elimination, linear.rows.gradient(row_weight * linear.target))
        error = np.add.reduceat((linear.rows.times(unknowns) - linear.target) ** 2, linear.first)
        robust = (config.student_freedom + size) / (config.student_freedom + error / by_scale**2)
        weight = np.where(used, np.where(linear.family == PRIOR, 1.0, robust), 0.0)
    return unknowns, inverse(elimination)


def _moved(
    evidence: Evidence, planes: FloatArray, step: FloatArray, config: EstimationConfig
) -> tuple[FloatArray, Mapping[tuple[int, int], FloatArray]]:
    """(S, 4) planes after a step of the linear system's unknowns, and the offset of each contact."""
    moved = planes.copy()
    for root, s in enumerate(np.nonzero(np.isfinite(planes[:, 0]))[0].tolist()):
        moved[s] = gtsam.OrientedPlane3(planes[s]).retract(step[root]).planeCoefficients()
    placed, before = met(evidence, planes), contact_offsets(evidence, planes, config)
    links = step[len(step) - len(placed) :]
    return moved, {evidence.contacts[c]: before[c] + link for c, link in zip(placed, links, strict=True)}
