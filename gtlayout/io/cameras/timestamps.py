"""Matching cameras to images by time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gtlayout.scene import FloatArray, IntArray

ROUNDING_S = 1e-9
"""What becomes of whole microseconds as seconds in floating point."""
MAX_CANDIDATES = 1000
"""A video has more frames than an offset of its timestamps can mean."""


def match_times(wanted_s: npt.ArrayLike, available_s: npt.ArrayLike, tolerance_s: float) -> IntArray:
    """(N,) for each of N wanted times the index of the nearest of M available ones within ``tolerance_s``, else -1.

    None is given away twice: it goes to the nearest wanted time (the first of equals), and the others get -1. Neither
    side need be sorted; of equal available times the first counts, and a time that is not finite matches nothing.
    """
    wanted = np.asarray(wanted_s, dtype=np.float64).ravel()
    times, index = _distinct(available_s)
    matched: IntArray = np.full(len(wanted), -1, dtype=np.int64)
    nearest, distance_s = _nearest(wanted, times)
    close = np.flatnonzero(distance_s <= tolerance_s + ROUNDING_S)
    best_first = close[np.argsort(distance_s[close], kind="stable")]
    taken, first = np.unique(nearest[best_first], return_index=True)
    matched[best_first[first]] = index[taken]
    return matched


def distances_s(wanted_s: npt.ArrayLike, available_s: npt.ArrayLike) -> FloatArray:
    """(N,) of each wanted time to the nearest available one, whoever has it; infinite where there is none."""
    return _nearest(np.asarray(wanted_s, dtype=np.float64).ravel(), _distinct(available_s)[0])[1]


def common_offset_s(wanted_s: npt.ArrayLike, available_s: npt.ArrayLike, tolerance_s: float) -> float | None:
    """What to add to the wanted times so that more of them match within ``tolerance_s``; None when nothing helps.

    Of the offsets that match the most, the smallest.
    """
    wanted = np.asarray(wanted_s, dtype=np.float64).ravel()
    times, _ = _distinct(available_s)
    if not len(wanted):
        return None

    def matches(offset_s: float) -> int:
        nearest, distance_s = _nearest(wanted + offset_s, times)
        return len(np.unique(nearest[distance_s <= tolerance_s + ROUNDING_S]))

    # A camera may lack its image: one of three is likely to have it.
    candidates = np.unique(times[None, :] - wanted[[0, len(wanted) // 2, -1], None])
    best, most = None, matches(0.0)
    for offset_s in candidates[np.argsort(np.abs(candidates), kind="stable")][:MAX_CANDIDATES]:
        if (count := matches(float(offset_s))) > most:
            best, most = float(offset_s), count
    return best


def _distinct(times_s: npt.ArrayLike) -> tuple[FloatArray, IntArray]:
    """The finite times, ascending, each once; and where each comes first."""
    times = np.asarray(times_s, dtype=np.float64).ravel()
    finite = np.flatnonzero(np.isfinite(times))
    distinct, first = np.unique(times[finite], return_index=True)
    return distinct, finite[first].astype(np.int64)


def _nearest(wanted: FloatArray, times: FloatArray) -> tuple[IntArray, FloatArray]:
    """Index and distance of the nearest of ascending ``times``; infinitely far without any."""
    if not len(times):
        return np.zeros(len(wanted), dtype=np.int64), np.full(len(wanted), np.inf)
    after = np.searchsorted(times, wanted).clip(0, len(times) - 1)
    before = (after - 1).clip(0)
    nearest = np.where(np.abs(times[before] - wanted) <= np.abs(times[after] - wanted), before, after)
    distance_s = np.abs(times[nearest] - wanted)
    return nearest, np.where(np.isfinite(wanted), distance_s, np.inf)
