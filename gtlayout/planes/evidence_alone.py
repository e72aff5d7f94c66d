"""What each kind of evidence says of a plane by itself, on the linearised system of all.

All other planes are held where the solution has them, and their σ is an error like others. A kind is compared with what
all other kinds say together, not with the solution, which it is a part of: so the two sides are independent. Errors
have the scale that the whole scene shows, but the weight of each measurement is judged by its own kind alone: what the
solution has outvoted speaks here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from gtlayout.planes.arrow import Tree, eliminate, solve
from gtlayout.planes.arrow_rows import Rows
from gtlayout.planes.config import UncertaintyConfig
from gtlayout.planes.linear_system import ANGLE, EDGE, JOINT, OFFSET, PRIOR, SHARED_DEPTH, TRACK, LinearSystem
from gtlayout.planes.trail import EvidenceAlone
from gtlayout.scene import BoolArray, FloatArray, IntArray

KINDS: Mapping[str, tuple[int, ...]] = {
    "tracks": (TRACK, SHARED_DEPTH),
    "contact edges": (EDGE, OFFSET),
    "right angles": (ANGLE,),
    "opening in its wall": (JOINT,),
}
"""The families of errors that make up each kind; of the first the measurements are counted. A further family of
measurements needs a line here, and nothing else."""

_ROUNDS = 6
"""Weights by residuals and planes by weights, in turn."""
_KNOWN = 0.5
"""As for dominant evidence: what is left with more than this share of the σ of priors alone is unknown."""
_BOTH_KNOWN = 1 / (2 * _KNOWN**2)
"""Information, in that of the prior, on the difference of two answers that are both known just so."""


@dataclass(frozen=True)
class _Says:
    """What some rows say of one plane, all else eliminated."""

    information: FloatArray
    """(3, 3) by the plane's tangent."""
    gradient: FloatArray
    """(3,) towards where they put it."""
    by_others: FloatArray
    """(3, 3P + Q) the gradient changes by so much for each unit of the other planes and of the errors of cameras."""

    def __add__(self, other: _Says) -> _Says:
        return _Says(
            self.information + other.information,
            self.gradient + other.gradient,
            self.by_others + other.by_others,
        )

    def answer(self, prior: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(3,) step to the plane and its (3, 3) covariance, given a prior's information and the others' covariance."""
        own: FloatArray = np.asarray(np.linalg.inv(self.information + prior))
        moved = own @ self.by_others
        return own @ self.gradient, own + moved @ covariance @ moved.T


def evidence_alone(
    linear: LinearSystem,
    scale: FloatArray,
    covariance: FloatArray,
    camera_errors: FloatArray,
    by_offset: FloatArray,
    config: UncertaintyConfig,
) -> list[tuple[EvidenceAlone, ...]]:
    """For each of P planes what each kind of evidence says that there is. Local unit.

    Args:
        linear: At the solution.
        scale: (7,) of each family's errors.
        covariance: (3P, 3P) of all planes' tangents.
        camera_errors: (R, Q) what each of Q independent errors of the cameras, of one σ, adds to the rows' target.
        by_offset: (P, 3) derivative of the offset amid what is drawn, n · middle + d, by the tangent.
    """
    covariance = block_diag(covariance, np.eye(camera_errors.shape[1]))
    owners, family = _owners(linear), np.repeat(linear.family, linear.size)
    found = []
    for i, of_offset in enumerate(by_offset):
        own = (owners == i).any(axis=1)
        weak = linear.rows.jacobian[own & (family == PRIOR)]
        prior = np.einsum("rui,ruj->ij", weak, weak)
        says, counts = {}, {}
        for kind, families in KINDS.items():
            rows = own & np.isin(family, families)
            first = linear.first[linear.family == families[0]]
            if counted := int(np.count_nonzero(rows[first])):
                says[kind], counts[kind] = _says(linear, scale, camera_errors, i, rows, config, prior), counted
        found.append(tuple(_alone(kind, says, counts[kind], prior, covariance, of_offset) for kind in says))
    return found


def _alone(
    kind: str,
    says: Mapping[str, _Says],
    measurements: int,
    prior: FloatArray,
    covariance: FloatArray,
    by_offset: FloatArray,
) -> EvidenceAlone:
    """One kind, against the sum of the others."""
    step, own = says[kind].answer(prior, covariance)
    chi2, freedom = np.nan, 0
    others = [one for other, one in says.items() if other != kind]
    if others:
        chi2, freedom = _difference((step, own), sum(others[1:], others[0]).answer(prior, covariance), prior)
    alone_by_prior = np.linalg.inv(prior)
    # The unit normal's tangent is in radians; a plane whose offset at a point grows has moved away from it.
    sigma_normal, unknown_normal = (np.sqrt(np.linalg.eigvalsh(of[:2, :2])[-1]) for of in (own, alone_by_prior))
    sigma_offset, unknown_offset = (np.sqrt(by_offset @ of @ by_offset) for of in (own, alone_by_prior))
    placed, turned = sigma_offset < _KNOWN * unknown_offset, sigma_normal < _KNOWN * unknown_normal
    return EvidenceAlone(
        kind=kind,
        measurements=measurements,
        offset=float(-by_offset @ step) if placed else np.nan,
        sigma_offset=float(sigma_offset) if placed else np.nan,
        tilt_deg=float(np.rad2deg(np.linalg.norm(step[:2]))) if turned else np.nan,
        sigma_normal_deg=float(np.rad2deg(sigma_normal)) if turned else np.nan,
        chi2=chi2,
        freedom=freedom,
    )


def _difference(
    one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray], prior: FloatArray
) -> tuple[float, int]:
    """χ² of the difference of two answers with their covariances, in the directions that both know, and their number.

    These are the eigenvectors of its information in units of the prior's.
    """
    unit = np.linalg.cholesky(prior)
    information = np.linalg.inv(unit.T @ (one[1] + other[1]) @ unit)
    known, directions = np.linalg.eigh(information)
    along = directions.T @ (unit.T @ (one[0] - other[0]))
    both = known >= _BOTH_KNOWN
    return (float(np.sum(known[both] * along[both] ** 2)), int(both.sum())) if both.any() else (np.nan, 0)


def _says(
    linear: LinearSystem,
    scale: FloatArray,
    camera_errors: FloatArray,
    plane: int,
    kept: BoolArray,
    config: UncertaintyConfig,
    prior: FloatArray,
) -> _Says:
    """What the rows that (R,) ``kept`` names say of one plane; with the (3, 3) information of a ``prior``, which only
    keeps the search for weights regular.
    """
    rows = _own(linear.rows.only(kept))
    planes, target = rows.tree.roots, linear.target[kept]
    # Other planes do not move.
    moving = (rows.unknown >= planes) | (rows.unknown == plane)
    alone = replace(rows, jacobian=rows.jacobian * moving[:, :, None])
    measurement = np.repeat(np.arange(len(linear.size)), linear.size)[kept]
    numbers, measurement = np.unique(measurement, return_inverse=True)
    size, spread = linear.size[numbers], scale[linear.family[numbers]]
    own, weak = np.s_[3 * plane : 3 * plane + 3], np.eye(3 * planes)
    weak[own, own] = prior
    weight = np.ones(len(numbers))
    for _ in range(_ROUNDS):
        row_weight = (weight / spread**2)[measurement]
        elimination = eliminate(rows.tree, alone.information(row_weight))
        regular = replace(elimination, root=elimination.root + weak)
        steps = solve(regular, alone.gradient(row_weight * target))
        error = np.bincount(measurement, (alone.times(steps) - target) ** 2, len(numbers)) / spread**2
        weight = (config.student_freedom + size) / (config.student_freedom + error)
    # Once biases and offsets are eliminated, a gradient is what the step was solved from.
    to_gradient = elimination.root[own, own] + prior
    by_others = eliminate(rows.tree, rows.information(row_weight)).root[own].copy()
    by_others[:, own] = 0.0
    by_cameras = [
        to_gradient @ solve(regular, alone.gradient(row_weight * change))[plane] for change in camera_errors[kept].T
    ]
    return _Says(
        elimination.root[own, own],
        to_gradient @ steps[plane],
        np.column_stack([by_others, *by_cameras]),
    )


def _own(rows: Rows) -> Rows:
    """The rows with only those branches, leaves and links that they touch; all roots stay."""
    tree = rows.tree
    used = np.unique(np.concatenate([rows.unknown.ravel(), rows.link]))
    branch, leaf, link = (
        used[(used >= start) & (used < end)] - start
        for start, end in pairwise([tree.roots, tree.roots + len(tree.root), tree.links_from, len(tree)])
    )
    number = np.full(len(tree), -1)
    kept = np.concatenate([np.arange(tree.roots), used[used >= tree.roots]])
    number[kept] = np.arange(len(kept))
    above = number[tree.roots + tree.branch[leaf]] - tree.roots
    return replace(
        rows,
        tree=Tree(tree.roots, tree.root[branch], above, tree.link[link]),
        unknown=number[rows.unknown],
        link=number[rows.link],
    )


def _owners(linear: LinearSystem) -> IntArray:
    """(R, 4) the planes that each row says something of: through its two unknowns, or the two ends of a link."""
    tree = linear.rows.tree
    roots = np.arange(tree.roots)
    single = np.concatenate([roots, tree.root, tree.root[tree.branch]])
    ends = np.concatenate([np.column_stack([single, single]), tree.link])
    return ends[linear.rows.unknown].reshape(-1, 4)
