"""Numbers out of files: finite, of the right type, and no larger than anything real."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtlayout.scene import FloatArray

MOST = 1e12
"""Millimetres to the moon: a position or an offset beyond it is an error."""
MOST_COUNTED = 10**9


def reals(value: Any, shape: tuple[int, ...], *, most: float = MOST, unknown: bool = False) -> FloatArray:
    """An array of finite numbers from (nested lists of) numbers; ``unknown``: null is NaN.

    A side of ``shape`` may be -1. Raises ValueError, with words to follow a name, when it holds anything else.
    """
    flat = np.asarray(value, dtype=object)
    allowed = (int, float, type(None)) if unknown else (int, float)
    if not all(isinstance(one, allowed) and not isinstance(one, bool) for one in flat.flat):
        raise ValueError("holds something that is no number")
    try:
        numbers = flat.astype(np.float64)
    except OverflowError:
        numbers = np.array([np.inf])
    if not (np.abs(numbers) <= most)[~np.isnan(numbers)].all() or (np.isnan(numbers).any() and not unknown):
        raise ValueError(f"holds a number that is not finite, or beyond {most:g}")
    return numbers.reshape(shape)


def real(value: Any, *, most: float = MOST, unknown: bool = False) -> float:
    """One such number."""
    return float(reals(value, (), most=most, unknown=unknown))


def whole(value: Any, least: int = 0, most: int = MOST_COUNTED) -> int:
    """A whole number. Raises ValueError when it is anything else, or out of bounds."""
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"must be a whole number from {least} to {most}")
    return value
