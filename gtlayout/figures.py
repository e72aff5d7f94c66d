"""Figures as text. What is not known is a dash or "unknown", never ``nan``, ``inf`` or a σ larger than its value."""

from __future__ import annotations

import math

NOTHING = "–"
"""In the place of a figure that does not exist."""
UNKNOWN = "unknown"
"""In the place of a σ that is not known."""


def figure(value: float | None, digits: int, unit: str = "", signed: bool = False) -> str:
    """``0.044 m`` for (0.044, 3, " m"); a dash for None, NaN and infinity."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{value:{'+' if signed else ''}.{digits}f}{unit}"


def short(value: float) -> str:
    """Three digits, and no exponent for what is large; a dash for NaN and infinity."""
    return f"{value:.3g}" if abs(value) < 100 else figure(value, 0)


def percent(share: float, digits: int = 0) -> str:
    """``31 %`` for .31; a dash for NaN."""
    return figure(100 * share, digits, " %")


def is_known(sigma: float | None, of: float | None) -> bool:
    """Whether a σ of a positive figure is known: both are finite, and σ is less than the figure itself."""
    return sigma is not None and of is not None and math.isfinite(of) and sigma < of


def sigma_figure(sigma: float | None, of: float | None, digits: int, unit: str = "") -> str:
    """A σ; ``unknown`` where it is not finite or no less than what it is the σ of, in the same unit."""
    return figure(sigma, digits, unit) if is_known(sigma, of) else UNKNOWN


def with_sigma(value: float, sigma: float, digits: int, unit: str = "") -> str:
    """``2.682 ± 0.159 m``, or ``2.682 m ± unknown``; a dash when the value is not known."""
    if is_known(sigma, value):
        return f"{figure(value, digits)} ± {figure(sigma, digits, unit)}"
    return f"{figure(value, digits, unit)} ± {UNKNOWN}" if math.isfinite(value) else NOTHING
