"""Results of costly steps, kept for when the same is asked again: a scene that is annotated is solved many times.

A step is known by everything that its result depends on, so what is kept is what would be made anew, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

T = TypeVar("T")
_MISSING = object()


class Memory:
    """Keeps nothing. ``LastingMemory`` keeps what was made."""

    def of(self, step: str, inputs: object, make: Callable[[], T]) -> T:
        """The result of ``step``: what ``make`` gives, or gave for the same inputs.

        Args:
            step: Name of the step, with a result of one type.
            inputs: All that the result depends on: numbers, strings, paths, arrays, geometries, and tuples, lists and
                dataclasses of these.
            make: Its result is never changed.
        """
        return make()


class LastingMemory(Memory):
    """Keeps what was made until ``forget_unused``."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, bytes], Any] = {}
        self._used: set[tuple[str, bytes]] = set()

    def of(self, step: str, inputs: object, make: Callable[[], T]) -> T:
        """See ``Memory``. Raises TypeError for inputs of other types."""
        key = step, fingerprint(inputs)
        self._used.add(key)
        # Another thread may forget in between, so the result is not looked up a second time.
        kept = self._kept.get(key, _MISSING)
        if kept is _MISSING:
            kept = self._kept[key] = make()
        return kept

    def forget_unused(self) -> None:
        """Drop what was not asked for since the last call."""
        self._kept = {key: value for key, value in self._kept.items() if key in self._used}
        self._used = set()


def fingerprint(value: object) -> bytes:
    """16 bytes that stand for a value. Raises TypeError for types other than those of ``Memory.of``."""
    digest = blake2b(digest_size=16)
    _feed(digest, value)
    return digest.digest()


def _feed(digest: blake2b, value: object) -> None:
    if isinstance(value, np.ndarray):
        digest.update(f"array {value.dtype.str} {value.shape} ".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, BaseGeometry):
        well_known = shapely.to_wkb(value)
        digest.update(f"geometry {len(well_known)} ".encode())
        digest.update(well_known)
    elif isinstance(value, tuple | list):
        digest.update(f"sequence {len(value)} ".encode())
        for item in value:
            _feed(digest, item)
    elif is_dataclass(value) and not isinstance(value, type):
        digest.update(f"{type(value).__qualname__} ".encode())
        for field in fields(value):
            _feed(digest, getattr(value, field.name))
    elif value is None or isinstance(value, bool | int | float | str | Path):
        text = repr(value)
        digest.update(f"{type(value).__name__} {len(text)} {text} ".encode())
    else:
        raise TypeError(f"a {type(value).__name__} cannot be told from others: {value!r}")
