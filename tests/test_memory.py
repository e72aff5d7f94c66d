"""What a memory keeps, and how it tells inputs apart."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from shapely import box

from gtlayout.memory import LastingMemory, Memory, fingerprint


@dataclass(frozen=True)
class Settings:
    size: float = 1.0


@dataclass(frozen=True)
class OtherSettings:
    size: float = 1.0


def test_what_was_made_is_given_again_until_it_is_not_used() -> None:
    memory, made = LastingMemory(), []

    def make() -> int:
        made.append(1)
        return len(made)

    assert [memory.of("a", (1, "x"), make) for _ in range(2)] == [1, 1]
    assert memory.of("b", (1, "x"), make) == 2
    assert memory.of("a", (1, "y"), make) == 3
    memory.forget_unused()
    assert memory.of("a", (1, "x"), make) == 1
    memory.forget_unused()
    assert memory.of("a", (1, "x"), make) == 1
    assert memory.of("b", (1, "x"), make) == 4


def test_by_default_nothing_is_kept() -> None:
    made: list[int] = []
    for _ in range(2):
        Memory().of("a", (), lambda: made.append(1))
    assert len(made) == 2


def test_a_memory_that_is_still_empty_is_a_memory() -> None:
    """Functions that take one say ``memory or Memory()``."""
    assert LastingMemory()


def test_inputs_that_differ_have_other_fingerprints() -> None:
    one = np.array([1.0, 2.0])
    values: list[object] = [
        one,
        one.astype(np.float32),
        one[:, None],
        np.nextafter(one, 3),
        [1.0, 2.0],
        [[1.0], 2.0],
        [1, 2],
        ["1", "2"],
        ["12"],
        [True, 2],
        None,
        Settings(),
        Settings(2.0),
        OtherSettings(),
        box(0, 0, 1, 1),
        box(0, 0, 1, 2),
        Path("a"),
        "a",
    ]
    assert len({fingerprint(value) for value in values}) == len(values)


def test_equal_inputs_have_one_fingerprint() -> None:
    strided = np.arange(8.0)[::2]
    assert fingerprint(strided) == fingerprint(strided.copy())
    assert fingerprint((1.0, [Settings()])) == fingerprint([1.0, (Settings(1.0),)])


def test_what_cannot_be_told_apart_is_refused() -> None:
    with pytest.raises(TypeError, match="function"):
        fingerprint([lambda: 0])
