"""Label Studio's run-length encoding of brush masks.

A mask is an RGBA image, row by row, packed by @thi.ng/rle-pack; the layout of the bits is told in the docstring of
``label_studio_sdk.converter.brush``: 32 bits, how many values follow; 5 bits, bits of a value - 1; four times 4 bits,
bits of a run's length - 1; then runs: 1 bit, whether one value repeats; 2 bits, which of the four lengths; the length
- 1; the one value, or as many as the length says.
"""

from __future__ import annotations

import numpy as np

from gtlayout.scene import BoolArray

MAX_PIXELS = 100_000_000
VALUE_BITS = 8
CHANNELS = 4


class BrokenMaskError(ValueError):
    """Bytes that are no mask of the size they should have; says why."""


def decode_mask(rle: bytes, size: tuple[int, int]) -> BoolArray:
    """(H, W) what a brush painted, for ``size`` (width, height) px.

    The brush has soft edges: a pixel counts when it is at least half as opaque as the most opaque one. That is
    unbiased, and finds masks of zeros and ones, too. Raises BrokenMaskError.
    """
    width, height = size
    if width * height > MAX_PIXELS:
        raise BrokenMaskError(f"a mask of {width}x{height} px is too large")
    bits = _Bits(rle)
    count = bits.read(32)
    if count != width * height * CHANNELS:
        raise BrokenMaskError(f"its mask holds {count} values, {width}x{height} px need {width * height * CHANNELS}")
    value_bits = bits.read(5) + 1
    if value_bits > VALUE_BITS:
        raise BrokenMaskError(f"its mask has values of {value_bits} bits")
    length_bits = [bits.read(4) + 1 for _ in range(4)]
    alpha = np.zeros(width * height, dtype=np.uint8)
    start = 0
    while start < count:
        head = bits.read(3)
        end = start + 1 + bits.read(length_bits[head & 3])
        if end > count:
            raise BrokenMaskError("its mask has a run beyond its end")
        if head >> 2:
            # Bytes 3, 7, 11, … are alpha: those within [start, end) belong to these pixels.
            alpha[start // CHANNELS : end // CHANNELS] = bits.read(value_bits)
        else:
            for index in range(start, end):
                value = bits.read(value_bits)
                if index % CHANNELS == CHANNELS - 1:
                    alpha[index // CHANNELS] = value
        start = end
    opaque = int(alpha.max(initial=0))
    return (alpha >= max((opaque + 1) // 2, 1)).reshape(height, width)


class _Bits:
    """Reads big-endian numbers of so many bits, one after another."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._position = 0

    def read(self, count: int) -> int:
        begin, self._position = self._position, self._position + count
        if self._position > 8 * len(self._data):
            raise BrokenMaskError("its mask ends too early")
        last = (self._position + 7) // 8
        chunk = int.from_bytes(self._data[begin // 8 : last], "big")
        return chunk >> (8 * last - self._position) & ((1 << count) - 1)
