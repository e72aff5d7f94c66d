"""What each kind of evidence says of a plane by itself, on the linearised system of all.

All other planes are held where the solution has them, and their σ is an error like others. A kind is compared with what
all other kinds say together, not with the solution, which it is a part of: so the two sides are independent. Errors
have the scale that the whole scene shows, but the weight of each measurement is judged by its own kind alone: what the
solution has outvoted speaks here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from gtlayout.planes.arrow import eliminate, solve
from gtlayout.planes.config import UncertaintyConfig
from gtlayout.planes.linear_system import ANGLE, EDGE, JOINT, OFFSET, PRIOR, SHARED_DEPTH, TRACK, LinearSystem
from gtlayout.planes.separate_rows import together, with_one_root
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
class _Question:
    """What does one kind say of one plane?"""

    plane: int
    kind: str
    rows: IntArray
    count: int
    """Of its measurements."""


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
    questions, priors = [], []
    for i in range(len(by_offset)):
        own = (owners == i).any(axis=1)
        weak = linear.rows.jacobian[own & (family == PRIOR)]
        priors.append(np.einsum("rui,ruj->ij", weak, weak))
        for kind, families in KINDS.items():
            rows = np.nonzero(own & np.isin(family, families))[0]
            if count := int(np.isin(linear.first[linear.family == families[0]], rows).sum()):
                questions.append(_Question(i, kind, rows, count))
    answers = _answers(linear, scale, camera_errors, questions, priors, config)
    found: list[tuple[EvidenceAlone, ...]] = []
    for i, of_offset in enumerate(by_offset):
        own_kinds = [(question, says) for question, says in zip(questions, answers, strict=True) if question.plane == i]
        by_kind = {question.kind: says for question, says in own_kinds}
        found.append(
            tuple(
                _alone(question.kind, by_kind, question.count, priors[i], covariance, of_offset)
                for question, _ in own_kinds
            )
        )
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


def _answers(
    linear: LinearSystem,
    scale: FloatArray,
    camera_errors: FloatArray,
    questions: Sequence[_Question],
    priors: Sequence[FloatArray],
    config: UncertaintyConfig,
) -> list[_Says]:
    """What the rows of each question say. All are answered at once, each with a plane, biases and offsets of its own.

    The (3, 3) information of a ``prior`` of each plane only keeps the search for weights regular.
    """
    if not questions:
        return []
    given = linear.rows
    alone = together(
        [with_one_root(given.only(_mask(question.rows, len(given.unknown))), question.plane) for question in questions]
    )
    index, asked = (
        np.concatenate([q.rows for q in questions]),
        np.repeat(np.arange(len(questions)), [len(q.rows) for q in questions]),
    )
    target = linear.target[index]
    measured = np.repeat(np.arange(len(linear.size)), linear.size)[index]
    numbers, measurement = np.unique(asked * len(linear.size) + measured, return_inverse=True)
    numbers %= len(linear.size)
    size, spread = linear.size[numbers], scale[linear.family[numbers]]
    prior = block_diag(*(priors[question.plane] for question in questions))
    weight = np.ones(len(numbers))
    for _ in range(_ROUNDS):
        row_weight = (weight / spread**2)[measurement]
        elimination = eliminate(alone.tree, alone.information(row_weight))
        regular = replace(elimination, root=elimination.root + prior)
        residual = alone.times(solve(regular, alone.gradient(row_weight * target))) - target
        error = np.bincount(measurement, residual**2, len(numbers)) / spread**2
        weight = (config.student_freedom + size) / (config.student_freedom + error)
    # What the rows change by when a plane moves, and its biases and offsets follow as they like best.
    towards = np.zeros((3, len(alone.tree), 3))
    towards[:, : len(questions)] = regular.root.reshape(len(questions), 3, -1, 3).sum(axis=2).transpose(2, 0, 1)
    followed = np.column_stack([alone.times(solve(regular, one)) for one in towards]) * row_weight[:, None]
    answers = []
    for number, question in enumerate(questions):
        own, here = np.s_[3 * number : 3 * number + 3], followed[asked == number]
        by_others = np.zeros((given.tree.roots, 3, 3))
        for side in range(2):
            unknown = given.unknown[question.rows, side]
            other = np.nonzero((unknown < given.tree.roots) & (unknown != question.plane))[0]
            by_other = here[other, :, None] * given.jacobian[question.rows[other], side, None]
            np.add.at(by_others, unknown[other], by_other)
        others = by_others.transpose(1, 0, 2).reshape(3, -1)
        answers.append(
            _Says(
                elimination.root[own, own],
                here.T @ linear.target[question.rows],
                np.column_stack([others, here.T @ camera_errors[question.rows]]),
            )
        )
    return answers


def _mask(index: IntArray, count: int) -> BoolArray:
    mask = np.zeros(count, dtype=bool)
    mask[index] = True
    return mask


def _owners(linear: LinearSystem) -> IntArray:
    """(R, 4) the planes that each row says something of: through its two unknowns, or the two ends of a link."""
    tree = linear.rows.tree
    roots = np.arange(tree.roots)
    single = np.concatenate([roots, tree.root, tree.root[tree.branch]])
    ends = np.concatenate([np.column_stack([single, single]), tree.link])
    return ends[linear.rows.unknown].reshape(-1, 4)
