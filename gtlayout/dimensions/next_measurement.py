"""Which dimension to measure by hand next: one that can be checked, after which most others are known well enough."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from gtlayout.accuracy import accuracy_of
from gtlayout.dimensions.facing import Taken
from gtlayout.instances import NextMeasurement
from gtlayout.measurement import GROSS_M, NAMED, TAPE_SIGMA_M
from gtlayout.scene import BoolArray, FloatArray

_LEAST_GAIN = 1e-9
_WORTH = 0.5
"""Where nothing can be checked, that which brings so much of the most that any would, and hides the smallest slip."""


def next_measurement(
    taken: Sequence[Taken], covariance: FloatArray, wanted_loa: int, metric: bool, by_neighbours: Collection[int] = ()
) -> NextMeasurement | None:
    """The dimension whose measurement brings most dimensions to the wanted level; None when all are there.

    Of those that are known well enough for a slip of ``GROSS_M`` to stand out, if one of them brings any to that level,
    or makes more of them checkable: so each measurement can be judged by those before it. Among equals the one that
    makes all together most certain. Where the unit of the scene is not known, the dimension
    that is known best as a share of itself: it gives the scene its unit with the smallest σ.

    Args:
        taken: The dimensions.
        covariance: (4S, 4S) joint covariance of all planes, about their anchor.
        wanted_loa: The level.
        metric: Whether the scene has a unit.
        by_neighbours: The instances that only their neighbours place: what reaches to one of them is not at any level
            before it is measured.
    """
    known = [i for i, (_, measured) in enumerate(taken) if np.isfinite(measured.sigma(covariance))]
    if not known:
        return None
    if not metric:
        best = min(known, key=lambda i: taken[i][1].sigma(covariance) / taken[i][1].value)
        return NextMeasurement(best, 0, 0, len(taken))
    gradients = np.stack([taken[i][1].gradient for i in known])
    drawn = np.array([taken[i][1].drawn_sigma for i in known]) ** 2
    rows = np.nonzero(gradients.any(axis=0))[0]
    joint = gradients[:, rows] @ covariance[np.ix_(rows, rows)] @ gradients[:, rows].T
    before = np.diag(joint) + drawn
    ends = [{taken[i][0].first, taken[i][0].second} for i in known]
    seen = np.array([not each & set(by_neighbours) for each in ends], dtype=bool)
    within = _within(before, wanted_loa) & seen
    if within.all():
        return None
    # (measured, of): what is drawn of a door or window is its own, and no other measurement tells it.
    after = before - joint**2 / (before + TAPE_SIGMA_M**2)[:, None]
    own = np.arange(len(known))
    after[own, own] = before * TAPE_SIGMA_M**2 / (before + TAPE_SIGMA_M**2)
    # Rounded: of dimensions that differ by nothing but rounding the first is proposed.
    gains = np.round(np.log(before / np.maximum(after, _LEAST_GAIN * before)).sum(axis=1), 6)
    reached = np.array(
        [
            np.sum(_within(each, wanted_loa) & (seen | [bool(ends[i] & other) for other in ends]))
            for i, each in enumerate(after)
        ]
    )
    checkable = np.array([_checkable(each).sum() for each in after])
    now = _checkable(before)
    useful = now & ((reached > within.sum()) | (checkable > now.sum()))
    brought = reached - within.sum()
    if useful.any():
        chosen = max(np.nonzero(useful)[0].tolist(), key=lambda i: (reached[i], checkable[i], gains[i]))
    elif brought.any():
        worth = np.nonzero(brought >= _WORTH * brought.max())[0]
        chosen = min(worth.tolist(), key=lambda i: (float(np.round(np.log(before[i]), 6)), -gains[i]))
    else:
        chosen = max(own.tolist(), key=lambda i: gains[i])
    return NextMeasurement(known[chosen], int(within.sum()), int(reached[chosen]), len(taken))


def _within(variances: FloatArray, wanted_loa: int) -> BoolArray:
    return np.array([accuracy_of(float(np.sqrt(v)), wanted_loa).status == "within" for v in variances], dtype=bool)


def _checkable(variances: FloatArray) -> BoolArray:
    """Where a slip of ``GROSS_M`` in a measurement would be named."""
    return np.asarray(NAMED * np.sqrt(variances + TAPE_SIGMA_M**2) <= GROSS_M)
