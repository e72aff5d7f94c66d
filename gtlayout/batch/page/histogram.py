"""How values are distributed: bars for the page, in the coordinates of an SVG drawing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

WIDTH, HEIGHT = 320.0, 90.0
"""Of the bars' area."""
_MOST_BARS, _MOST_TICKS = 24, 7
_TAIL_SHARE = 0.98
"""Values beyond this quantile share the last bar where no end is given: one slow scene must not hide the rest."""


def histogram(
    values: Sequence[float], low: float = 0.0, high: float | None = None, mark: float | None = None
) -> dict[str, Any] | None:
    """Bars from ``low`` to ``high`` with a width of 1, 2 or 5 times a power of ten; None without values.

    Without ``high`` the last bar holds what lies beyond, too. ``mark`` is a value to draw a line at; bars wholly
    below it are "below".
    """
    if not values:
        return None
    numbers = np.asarray(values, dtype=np.float64)
    open_ended = high is None
    end = float(np.quantile(numbers, _TAIL_SHARE)) if high is None else high
    step = _nice_step(max(end - low, 1e-9) / _MOST_BARS)
    first = math.floor(low / step + 1e-9)
    count = max(1, math.ceil(end / step - 1e-9) - first)
    at = np.clip(np.floor(numbers / step + 1e-9).astype(int) - first, 0, count if open_ended else count - 1)
    counts = np.bincount(at, minlength=count)
    bar = WIDTH / len(counts)
    tallest = int(counts.max())

    def x(value: float) -> float:
        return round(min(max((value / step - first) * bar, 0.0), WIDTH), 2)

    apart = next(bars for bars in (1, 2, 5, 10) if (count + 1) / bars <= _MOST_TICKS)
    ticks = [i for i in range(count + 1) if (first + i) % apart == 0]
    median = float(np.median(numbers))
    return {
        "bars": [
            {
                "x": round(i * bar, 2),
                "width": round(bar * 0.9, 2),
                "height": round(HEIGHT * number / tallest, 2),
                "count": number,
                "from": f"{(first + i) * step:.4g}",
                "to": None if i == count else f"{(first + i + 1) * step:.4g}",
                "below": mark is not None and (first + i + 1) * step <= mark + 1e-9,
            }
            for i, number in enumerate(counts.tolist())
            if number
        ],
        "ticks": [{"x": round(i * bar, 2), "text": f"{(first + i) * step:.4g}"} for i in ticks],
        "median": {"x": x(median), "value": median},
        "mark": None if mark is None else {"x": x(mark), "value": mark},
        "count": len(values),
        "tallest": tallest,
    }


def _nice_step(least: float) -> float:
    """The smallest 1, 2 or 5 times a power of ten that is not less."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= least * (1 - 1e-9))
