"""Scrambled Sobol points in the unit square: those of ``scipy.stats.qmc.Sobol(2)``, of which the import takes .3 s."""

from __future__ import annotations

import numpy as np

from gtlayout.scene import FloatArray, IntArray

_BITS = 30
"""Of each coordinate, as many as SciPy takes."""


def sobol_points(count: int, seed: int) -> FloatArray:
    """(``count``, 2) first points of a Sobol sequence, each coordinate in [0, 1).

    Scrambled by a random lower triangular matrix and a random shift (Matoušek, On the L2-discrepancy for anchored
    boxes, 1998). Deterministic in ``seed``, and the first points of a longer sequence.
    """
    random = np.random.default_rng(seed)
    draw = np.uint32  # SciPy's type: the generator gives other numbers for another.
    shift = random.integers(2, size=(2, _BITS), dtype=draw).astype(np.int64) @ (1 << np.arange(_BITS))
    lower = np.tril(random.integers(2, size=(2, _BITS, _BITS), dtype=draw), -1).astype(np.int64)
    scrambled = np.bitwise_or(lower, np.eye(_BITS, dtype=np.int64)) @ _direction_bits()
    directions = (scrambled % 2 << np.arange(_BITS - 1, -1, -1)[:, None]).sum(axis=1)
    # In order of Gray code, one bit differs from one point to the next.
    number = np.arange(count)
    gray, points = number ^ number >> 1, np.tile(shift, (count, 1))
    for j in range(max(count - 1, 0).bit_length()):
        points ^= (gray >> j & 1)[:, None] * directions[:, j]
    return points / float(1 << _BITS)


def _direction_bits() -> IntArray:
    """(2, bits, bits) direction numbers, a column each, the highest bit first (Joe and Kuo, 2008).

    The first coordinate is van der Corput's sequence. The second has the primitive polynomial x + 1: each number is the
    one before, and the same shifted by one.
    """
    second = [1 << _BITS - 1]
    for _ in range(_BITS - 1):
        second.append(second[-1] ^ second[-1] >> 1)
    bits = [[number >> _BITS - 1 - row & 1 for number in second] for row in range(_BITS)]
    return np.stack([np.eye(_BITS, dtype=np.int64), np.array(bits)])
