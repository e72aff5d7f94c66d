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
    wanted, distance_s, nearest = _nearest(wanted_s, available_s)
    matched: IntArray = np.full(len(wanted), -1, dtype=np.int64)
    close = np.flatnonzero(distance_s <= tolerance_s + ROUNDING_S)
    best_first = close[np.argsort(distance_s[close], kind="stable")]
    taken, first = np.unique(nearest[best_first], return_index=True)
    matched[best_first[first]] = taken
    return matched


def common_offset_s(wanted_s: npt.ArrayLike, available_s: npt.ArrayLike, tolerance_s: float) -> float | None:
    """What to add to the wanted times so that more of them match within ``tolerance_s``; None when nothing helps.

    Of the offsets that match the most, the smallest.
    """
    wanted, available = (np.asarray(times, dtype=np.float64).ravel() for times in (wanted_s, available_s))
    matches = int(np.count_nonzero(match_times(wanted, available, tolerance_s) >= 0))
    if not len(wanted):
        return None
    # A camera may lack its image: one of three is likely to have it.
    anchors = wanted[[0, len(wanted) // 2, -1]]
    candidates = np.unique(available[None, :] - anchors[:, None])
    candidates = candidates[np.isfinite(candidates)]
    best = None
    for offset in candidates[np.argsort(np.abs(candidates), kind="stable")][:MAX_CANDIDATES]:
        count = int(np.count_nonzero(match_times(wanted + offset, available, tolerance_s) >= 0))
        if count > matches:
            best, matches = float(offset), count
    return best


def _nearest(wanted_s: npt.ArrayLike, available_s: npt.ArrayLike) -> tuple[FloatArray, FloatArray, IntArray]:
    """The wanted times, and of each the distance and the index of the nearest available one (infinite without any)."""
    wanted, available = (np.asarray(times, dtype=np.float64).ravel() for times in (wanted_s, available_s))
    order = np.argsort(available, kind="stable")
    order = order[np.isfinite(available[order])]
    # Of equal times the first one stays.
    times, first = np.unique(available[order], return_index=True)
    if not len(times):
        return wanted, np.full(len(wanted), np.inf), np.zeros(len(wanted), dtype=np.int64)
    after = np.searchsorted(times, wanted).clip(0, len(times) - 1)
    before = (after - 1).clip(0)
    nearest = np.where(np.abs(times[before] - wanted) <= np.abs(times[after] - wanted), before, after)
    distance_s = np.abs(times[nearest] - wanted)
    return wanted, np.where(np.isfinite(wanted), distance_s, np.inf), order[first[nearest]].astype(np.int64)
