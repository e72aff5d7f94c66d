"""PNG files before libpng sees them: it writes lines of its own to stderr about what is damaged or odd."""

from __future__ import annotations

import struct
import zlib

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_DECIDES_PIXELS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND", b"acTL", b"fcTL", b"fdAT")


def plain_png(png: bytes) -> bytes | None:
    """The same image with nothing but what decides its pixels; None when it is cut off or damaged."""
    parts, place, kind = [SIGNATURE], len(SIGNATURE), b""
    while kind != b"IEND":
        if place + 12 > len(png):
            return None
        length, kind = struct.unpack_from(">I4s", png, place)
        chunk = png[place : place + length + 12]
        if kind in _DECIDES_PIXELS:
            if len(chunk) < length + 12 or zlib.crc32(chunk[4:-4]) != struct.unpack(">I", chunk[-4:])[0]:
                return None
            parts.append(chunk)
        place += length + 12
    return b"".join(parts)
