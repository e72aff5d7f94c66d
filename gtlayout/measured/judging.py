"""Each measurement judged by all others and the video: which contradict, and how much the rest may move.

Reference for the test: Baarda's data snooping in geodesy ("A testing procedure for use in geodetic networks", 1968):
each against its prediction from the inverse of the residuals' covariance. For what the rest may move: Huber's bounded
influence ("Robust estimation of a location parameter", 1964).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.measurement import SURE, held_back_by
from gtlayout.scene import BoolArray, FloatArray

_TIE = 1.05
"""Nothing tells which of two measurements is wrong when they are nearly as far off as each other, in σ…"""
_TELLS = SURE**2
"""… unless the squares of these differ by so much: that is twice the logarithm of how much likelier one is wrong."""
_ROUNDS = 20
"""Of finding what each measurement counts as, which depends on the others."""
_TOO_LITTLE = 1e3
"""In σ of the measurement by hand: where everything else predicts it worse than this, nothing is held back by it."""


@dataclass(frozen=True)
class Judged:
    """What came of M measurements; all in the unit of their residuals."""

    contradicting: BoolArray
    """(M,) the furthest off of those that contradict all else, and those that may be wrong in its place."""
    predicted: FloatArray
    """(M,) each residual as the others that are used predict it."""
    sigma: FloatArray
    """(M,) σ of the difference from it."""
    added: FloatArray
    """(M,) variance that is added to each so that it moves nothing by more than ``PULL`` σ."""


def judge(of_video: FloatArray, noise: FloatArray, residual: FloatArray, used: BoolArray) -> Judged:
    """Judge measurements by all others that are ``used``.

    One that lies between ``PULL`` σ and ``SURE`` from its prediction may be right, or off by a slip that cannot be told
    from what the video has wrong. It counts so much less that it alone moves nothing by more than ``PULL`` σ. A second
    measurement that agrees changes that: then the others know better.

    Args:
        of_video: (M, M) covariance of the predictions by the video.
        noise: (M, M) of the measurements.
        residual: (M,) measured minus predicted.
    """
    predicted, sigma = _left_out(of_video + noise, residual, used)
    contradicting = _contradicting(np.where(used, np.abs(residual - predicted) / sigma, 0.0))
    added = np.zeros(len(residual))
    if contradicting.any():
        return Judged(contradicting, predicted, sigma, added)
    own = np.diag(noise)
    for _ in range(_ROUNDS):
        predicted, with_added = _left_out(of_video + noise + np.diag(added), residual, used)
        sigma = np.sqrt(np.maximum(with_added**2 - added, 1e-30))
        doubtful = used & (sigma**2 < _TOO_LITTLE**2 * own)
        wanted = np.where(doubtful, held_back_by(np.abs(residual - predicted) / sigma, sigma), 0.0)
        # Half way: each step changes what the others say.
        added = (added + wanted) / 2
    return Judged(contradicting, predicted, sigma, added)


def _left_out(spread: FloatArray, residual: FloatArray, used: BoolArray) -> tuple[FloatArray, FloatArray]:
    """(M,) each residual as all others that are used predict it, and the σ of the difference."""
    predicted, sigma = np.zeros(len(residual)), np.zeros(len(residual))
    for i in range(len(residual)):
        others = used.copy()
        others[i] = False
        by = np.linalg.solve(spread[np.ix_(others, others)], spread[others, i]) if others.any() else np.empty(0)
        predicted[i] = by @ residual[others]
        sigma[i] = np.sqrt(max(spread[i, i] - by @ spread[others, i], 1e-30))
    return predicted, sigma


def _contradicting(deviations: FloatArray) -> BoolArray:
    """(M,) the one that is furthest off, of those too far; with it those that may be wrong in its place."""
    worst = deviations.max(initial=0.0)
    may_be_it = (deviations * _TIE >= worst) & (deviations**2 > worst**2 - _TELLS)
    chosen: BoolArray = (deviations > SURE) & may_be_it
    return chosen
