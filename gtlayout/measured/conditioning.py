"""Planes and scale, given what was measured by hand.

The planes after the video are normally distributed, with the joint covariance of stage 4, which also holds what no
factor of the graph does: wrong cameras, and the weights of the solve. So measurements join after the solve, as one
factor each on that distribution; the logarithm of the scale is one more unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtlayout.dimensions.measurable import Measurable
from gtlayout.measured.judging import judge
from gtlayout.measurement import Checked, Measurement
from gtlayout.scene import BoolArray, FloatArray

_ROUNDS = 3
"""Of Gauss and Newton: the logarithm of a length is not linear in the planes."""
_NO_SCALE = 10.0
"""σ of the logarithm of a scale of which nothing is known."""


@dataclass(frozen=True)
class Posterior:
    """What planes and scale are, given the measurements."""

    moved: FloatArray
    """(4S,) by how much each plane's (normal, normal · anchor + d) moves, in the units of the given world."""
    scale: float
    """Metres in a unit of the world."""
    covariance: FloatArray
    """(4S + 1, 4S + 1) of the planes, and of the logarithm of the scale; NaN for planes that are not placed."""
    checked: tuple[Checked, ...]


def condition(
    covariance: FloatArray,
    measurements: Sequence[Measurement],
    measurables: Sequence[Measurable],
    scale_sigma_share: float | None,
) -> Posterior | None:
    """Planes and scale given measurements.

    Measurements that contradict the video and all others are found one by one, the worst first, and not used. Where two
    contradict each other and nothing else tells which is wrong, neither is used. Of those that are used none moves
    anything by more than its σ without it: see ``judging.judge``.

    Args:
        covariance: (4S, 4S) joint covariance of all planes, NaN for those that are not placed.
        measurables: What each measurement is of, at the planes as they are.
        scale_sigma_share: σ of the scale as a share of it; None when the unit of the world is not known.

    Returns:
        None when the unit is not known and no measurement that is used tells it.
    """
    lengths = np.array([one.kind != "angle" for one in measurements], dtype=bool)
    used = np.ones(len(measurements), dtype=bool)
    prior = _prior(covariance, scale_sigma_share)
    rows, noise, residual = _linearised(measurements, measurables, lengths, len(prior))
    known = np.isfinite(np.diag(prior))
    prior_known, rows = prior[np.ix_(known, known)], rows[:, known]
    of_video = rows @ prior_known @ rows.T
    start = 0.0
    while True:
        if scale_sigma_share is None:
            if not (lengths & used).any():
                return None
            start = float(np.median(residual[lengths & used]))
        judged = judge(of_video, noise, residual - start * lengths, used)
        if not judged.contradicting.any():
            break
        used &= ~judged.contradicting
    chosen = np.nonzero(used)[0].tolist()
    moved, posterior = np.zeros(len(prior)), np.full_like(prior, np.nan)
    for _ in range(_ROUNDS):
        at = [measurables[i].moved(moved[:-1]) for i in chosen]
        rows, noise_then, residual = _linearised([measurements[i] for i in chosen], at, lengths[chosen], len(prior))
        innovation = residual - start * lengths[chosen] + rows[:, :-1] @ moved[:-1]
        rows = rows[:, known]
        spread = rows @ prior_known @ rows.T + noise_then + np.diag(judged.added[chosen])
        gain = np.linalg.solve(spread, rows @ prior_known).T
        moved[known] = gain @ innovation
        after = prior_known - gain @ rows @ prior_known
        posterior[np.ix_(known, known)] = (after + after.T) / 2
    scale = float(np.exp(start + moved[-1]))
    checked = tuple(
        _checked(one, measurables[i], start * lengths[i] + judged.predicted[i], judged.sigma[i], bool(used[i]))
        for i, one in enumerate(measurements)
    )
    return Posterior(moved[:-1], scale, posterior, checked)


def _prior(covariance: FloatArray, scale_sigma_share: float | None) -> FloatArray:
    """(4S + 1, 4S + 1) with the logarithm of the scale."""
    prior = np.zeros((len(covariance) + 1,) * 2)
    prior[:-1, :-1] = covariance
    prior[-1, -1] = (_NO_SCALE if scale_sigma_share is None else scale_sigma_share) ** 2
    return prior


def _linearised(
    measurements: Sequence[Measurement], measurables: Sequence[Measurable], lengths: BoolArray, unknowns: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(M, 4S + 1) derivatives, (M, M) noise and (M,) residuals: of the logarithm of lengths, of angles in radians."""
    rows, noise, drawn, residual = [], [], [], []
    for one, of, is_length in zip(measurements, measurables, lengths, strict=True):
        if is_length:
            rows.append(np.append(of.gradient / of.value, 1.0))
            noise.append((one.sigma / one.value) ** 2)
            drawn.append(of.drawn_sigma / of.value)
            residual.append(np.log(one.value / of.value))
        else:
            rows.append(np.append(of.gradient, 0.0))
            noise.append(np.deg2rad(one.sigma) ** 2)
            drawn.append(0.0)
            residual.append(np.deg2rad(one.value) - of.value)
    # What is drawn of a door is off alike however often the door is measured.
    same = np.array(
        [
            [(a.kind, a.instances, a.points) == (b.kind, b.instances, b.points) for b in measurements]
            for a in measurements
        ]
    )
    of_drawing = np.outer(drawn, drawn) * same.reshape(len(drawn), len(drawn))
    return np.array(rows).reshape(-1, unknowns), np.diag(noise) + of_drawing, np.array(residual)


def _checked(measurement: Measurement, of: Measurable, residual: float, sigma: float, used: bool) -> Checked:
    """``residual`` is what everything else says beyond ``of``, ``sigma`` that of the measurement and all else."""
    own = np.deg2rad(measurement.sigma) if measurement.kind == "angle" else measurement.sigma / measurement.value
    of_prediction = float(np.sqrt(max(sigma**2 - own**2, 0.0)))
    if sigma > _NO_SCALE / 2:
        return Checked(measurement, np.nan, np.nan, used)
    if measurement.kind == "angle":
        return Checked(measurement, float(np.rad2deg(of.value + residual)), float(np.rad2deg(of_prediction)), used)
    length = of.value * float(np.exp(residual))
    return Checked(measurement, length, length * of_prediction, used)
