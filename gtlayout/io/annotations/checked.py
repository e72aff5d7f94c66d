"""Values out of an annotation tool's file, checked: wrong ones become messages, and none becomes huge."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeGuard

import numpy as np

from gtlayout.io.files import printable
from gtlayout.scene import FloatArray

NO_OCCLUSION_EDGES = "no occlusion edges, so neighbours are taken to touch everywhere"
"""The warning for formats without them."""
MAX_PX = 1e6
"""No image is that large: a coordinate beyond it is an error."""
MAX_NAME = 1000
"""Signs; longer ones are no names."""
MAX_WHERE = 120
"""Signs that say where something is: a tool's file may call an image by a whole text."""
MAX_REASONS = 5
"""In an error; more do not fit into its line."""


CURVED = "curved"
"""What the attribute of a curved wall is called in every format."""
_YES, _NO = frozenset({"true", "yes", "1", CURVED}), frozenset({"", "false", "no", "0", "flat"})


class UnusableError(Exception):
    """A shape that cannot be used; its text follows "polygon skipped" or the like."""


@dataclass
class Notes:
    """What was left out or lost: one line per kind, with the number and the first place."""

    counts: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)

    def add(self, what: str, where: str) -> None:
        """Count one more ``what``."""
        self.counts[what] += 1
        self.first.setdefault(what, where if len(where) <= MAX_WHERE else f"{where[: MAX_WHERE - 1]}…")

    def lines(self, file: str) -> list[str]:
        """One line per kind."""
        named = printable(file)
        return [f"{named}: {what} ({n}, first in {self.first[what]})" for what, n in self.counts.items()]


def because(reasons: Sequence[str], file: str) -> str:
    """ " (one; another)" to end an error that names ``file``, with what readers left out of it; nothing for nothing."""
    named = [reason.removeprefix(f"{file}: ") for reason in reasons[:MAX_REASONS]]
    more = [f"and {len(reasons) - MAX_REASONS} more reasons"] if len(reasons) > MAX_REASONS else []
    return f" ({'; '.join([*named, *more])})" if named else ""


def is_px(value: Any) -> TypeGuard[float]:
    """Whether it is a number that can be a coordinate, or a size."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MAX_PX


def name(value: Any) -> str | None:
    """A name as text; None when it is empty or no name. Numbers, which some tools make of names, become text again."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, str | int):
        return None
    text = printable(str(value)).strip()
    return text if 0 < len(text) <= MAX_NAME else None


def is_curved(value: Any, notes: Notes, where: str) -> bool:
    """What the attribute ``curved`` says, as each tool writes it; what is neither yes nor no is noted, and is no."""
    text = str(value).casefold().strip() if isinstance(value, bool | int | str) else "" if value is None else "?"
    if text not in _YES | _NO:
        shown = name(value) or f"of type {type(value).__name__}"
        notes.add(f"{CURVED} is {shown}, neither true nor false: taken as false", where)
    return text in _YES


def image_size(width: Any, height: Any) -> tuple[int, int] | None:
    """(width, height) px; None when the file does not say it, which some tools do with 0."""
    if type(width) is int and type(height) is int and 0 < width <= MAX_PX and 0 < height <= MAX_PX:
        return width, height
    return None


def points(values: Any) -> FloatArray:
    """(N, 2) px from a list x, y, x, y, …; raises UnusableError."""
    numbers = isinstance(values, list) and all(map(is_px, values))
    if not numbers or len(values) % 2:
        raise UnusableError("its points are no pairs of finite numbers")
    return np.array(values, dtype=np.float64).reshape(-1, 2)


def pairs(values: Any) -> FloatArray:
    """(N, 2) px from a list of [x, y]; raises UnusableError."""
    if not isinstance(values, list) or not all(isinstance(point, list) and len(point) == 2 for point in values):
        raise UnusableError("its points are no pairs of finite numbers")
    return points([value for point in values for value in point])
