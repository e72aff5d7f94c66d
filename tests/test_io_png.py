"""PNG files: the pixels that OpenCV reads, and nothing on stderr, whatever is wrong with them."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.masks import decode_mask
from gtlayout.io.pixels.images import decode

WIDTH, HEIGHT = 13, 7
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
KINDS = [(depth, 0) for depth in (1, 2, 4, 8, 16)] + [(depth, 3) for depth in (1, 2, 4, 8)]
KINDS += [(depth, color) for color in (2, 4, 6) for depth in (8, 16)]


def chunk(kind: bytes, data: bytes = b"") -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def rows(depth: int, color: int) -> bytes:
    """Random pixels, each row with its filter, none."""
    rng = np.random.default_rng(depth + color)
    length = -(-WIDTH * CHANNELS[color] * depth // 8)
    return b"".join(b"\0" + rng.bytes(length) for _ in range(HEIGHT))


def png(
    depth: int = 8, color: int = 0, pixels: bytes | None = None, head: bytes | None = None, more: bytes = b""
) -> bytes:
    """A file of the standard's kind; ``more`` stands between its palette and its pixels."""
    head = head or struct.pack(">IIBBBBB", WIDTH, HEIGHT, depth, color, 0, 0, 0)
    palette = chunk(b"PLTE", np.random.default_rng(1).bytes(3 << depth)) if color == 3 else b""
    data = zlib.compress(rows(depth, color) if pixels is None else pixels)
    parts = (chunk(b"IHDR", head), palette, more, chunk(b"IDAT", data), chunk(b"IEND"))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


@pytest.mark.parametrize(("depth", "color"), KINDS)
def test_the_pixels_are_those_that_opencv_reads(depth: int, color: int, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(png(depth, color))
    data = np.frombuffer(path.read_bytes(), np.uint8)
    for mode in (cv2.IMREAD_COLOR, cv2.IMREAD_COLOR_RGB):
        np.testing.assert_array_equal(decode(path, mode), cv2.imdecode(data, mode))
    stored = decode(path, cv2.IMREAD_UNCHANGED)
    if color == 0:
        expected = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        assert expected is not None
        assert stored.dtype == expected.dtype
        np.testing.assert_array_equal(stored, expected)
    assert (stored.ndim == 2) == (color == 0)
    assert decode(path, cv2.IMREAD_GRAYSCALE).shape == (HEIGHT, WIDTH)


PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
SHORT = rows(8, 0)[: 3 * (WIDTH + 1)]
INTERLACED = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 0, 0, 0, 1)
DAMAGED = {
    "too little data": png(pixels=SHORT),
    "too little data, interlaced": png(pixels=SHORT, head=INTERLACED),
    "no data": png(pixels=b""),
    "no such filter": png(pixels=b"\x09" + rows(8, 0)[1:]),
    "no such kind": png(head=struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 5, 0, 0, 0)),
    "no width": png(head=struct.pack(">IIBBBBB", 0, HEIGHT, 8, 0, 0, 0, 0)),
    "short head": png(head=b"\0" * 5),
    "no stream": png().replace(chunk(b"IDAT", zlib.compress(rows(8, 0))), chunk(b"IDAT", b"\xff" * 40)),
    "two heads": png(more=png()[8:33]),
    "pixels before the head": png()[:8] + chunk(b"IDAT", b"") + png()[8:],
}


def test_a_last_row_of_zeros_is_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(png(pixels=rows(8, 0)[: -WIDTH - 1] + bytes(WIDTH + 1)))
    assert decode(path, cv2.IMREAD_UNCHANGED)[:-1].any(axis=1).all()


@pytest.mark.parametrize("color", [0, 2])
def test_interlaced_files_are_read_whole(color: int, tmp_path: Path) -> None:
    """In any size: small ones lack passes."""
    path = tmp_path / "a.png"
    for width, height in [(1, 1), (2, 5), (5, 3), (8, 8), (13, 7)]:
        sizes = [(-(-max(width - x, 0) // dx), -(-max(height - y, 0) // dy)) for x, y, dx, dy in PASSES]
        data = b"".join(
            b"\0" + bytes([k + 1] * CHANNELS[color] * w) for k, (w, h) in enumerate(sizes) if w for _ in range(h)
        )
        path.write_bytes(png(8, color, data, struct.pack(">IIBBBBB", width, height, 8, color, 0, 0, 1)))
        image = decode(path, cv2.IMREAD_COLOR)
        np.testing.assert_array_equal(image, cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_COLOR))
        # Without its last row, of whichever pass.
        last = 1 + CHANNELS[color] * next(w for w, h in reversed(sizes) if w and h)
        path.write_bytes(png(8, color, data[:-last], struct.pack(">IIBBBBB", width, height, 8, color, 0, 0, 1)))
        with pytest.raises(GtlayoutError, match="damaged"):
            decode(path, cv2.IMREAD_COLOR)


@pytest.mark.parametrize("what", DAMAGED)
def test_what_is_damaged_is_said_once(what: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(DAMAGED[what])
    for mode in (cv2.IMREAD_COLOR, cv2.IMREAD_UNCHANGED):
        with pytest.raises(GtlayoutError, match=r"cannot read image .*a\.png"):
            decode(path, mode)
    with pytest.raises(ValueError, match="image"):
        decode_mask(DAMAGED[what])
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("more", [chunk(b"PLTE", b"\0" * 6), chunk(b"tRNS", b"\0" * 9), chunk(b"iCCP", b"x")])
def test_what_is_odd_is_read_and_not_said(more: bytes, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Of these libpng says that it ignores them."""
    path = tmp_path / "a.png"
    path.write_bytes(png(more=more))
    expected = np.frombuffer(rows(8, 0), np.uint8).reshape(HEIGHT, WIDTH + 1)[:, 1:]
    np.testing.assert_array_equal(decode(path, cv2.IMREAD_UNCHANGED), expected)
    assert capfd.readouterr() == ("", "")


def test_a_size_that_only_a_damaged_profile_hides_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    head = struct.pack(">IIBBBBB", 1 << 20, 1 << 20, 8, 0, 0, 0, 0)
    path.write_bytes(png(head=head, more=chunk(b"iCCP", b"")))
    with pytest.raises(GtlayoutError, match="more than 128 megapixels"):
        decode(path, cv2.IMREAD_COLOR)
