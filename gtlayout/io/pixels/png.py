"""PNG files, decoded without libpng: it writes lines of its own to stderr about what is damaged or odd."""

from __future__ import annotations

import io
import struct
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL.PngImagePlugin import PngImageFile

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_DECIDES_PIXELS = (b"IHDR", b"PLTE", b"IDAT", b"IEND")
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Values of a pixel, by colour type."""
_PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
"""First column and row, step to the next column and row, of the passes of an interlaced image (PNG, section 8.2)."""


def plain_png(png: bytes) -> bytes | None:
    """The same image with nothing but what decides its pixels; None when it is cut off or damaged.

    Transparency and the further frames of an animation are left out.
    """
    parts, place, kind = [SIGNATURE], len(SIGNATURE), b""
    while kind != b"IEND":
        if place + 12 > len(png):
            return None
        length, kind = struct.unpack_from(">I4s", png, place)
        chunk = png[place : place + length + 12]
        if kind in _DECIDES_PIXELS:
            # The header is the first, and there is one.
            if (kind == b"IHDR") != (len(parts) == 1) or len(chunk) < length + 12:
                return None
            if zlib.crc32(chunk[4:-4]) != struct.unpack(">I", chunk[-4:])[0]:
                return None
            parts.append(chunk)
        place += length + 12
    return b"".join(parts)


def decode_png(plain: bytes) -> npt.NDArray[Any] | None:
    """(H, W) uint8 or uint16 grey values, or (H, W, 3) uint8 BGR, of a file as ``plain_png`` makes it.

    None when it is damaged.
    """
    try:
        with PngImageFile(io.BytesIO(plain)) as image:
            pixels = np.array(image)
            # Pillow leaves the rows at zero that there is no data for.
            if not pixels[-1].any() or image.info.get("interlace"):
                _require_all_rows(plain)
            if image.mode in ("L", "I;16"):
                return pixels
            if image.mode == "1":
                return np.array(image.convert("L"))
            return np.ascontiguousarray(np.array(image.convert("RGB"))[..., ::-1])
    except Exception:  # Pillow raises what its parsers raise: SyntaxError, OSError, ValueError, struct.error, …
        return None


def _require_all_rows(plain: bytes) -> None:
    """Raises ValueError when a file holds less data than its size takes."""
    width, height, depth, color, _, _, interlaced = struct.unpack_from(">IIBBBBB", plain, len(SIGNATURE) + 8)
    expected = 0
    for x, y, step_x, step_y in _PASSES if interlaced else ((0, 0, 1, 1),):
        columns, rows = -(-max(width - x, 0) // step_x), -(-max(height - y, 0) // step_y)
        expected += rows * (1 + -(-columns * depth * _CHANNELS[color] // 8)) if columns else 0
    data, place = [], len(SIGNATURE)
    while place < len(plain):
        length, kind = struct.unpack_from(">I4s", plain, place)
        data += [plain[place + 8 : place + 8 + length]] if kind == b"IDAT" else []
        place += length + 12
    if len(zlib.decompressobj().decompress(b"".join(data), expected)) < expected:
        raise ValueError("too little data")
