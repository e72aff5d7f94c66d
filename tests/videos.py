"""Small videos, made with PyAV."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.stream import VideoStream

from gtlayout.scene import ImageArray

WIDTH, HEIGHT = 160, 96


def pictures(count: int) -> list[ImageArray]:
    """Noise that grows lighter, with a white corner at the top left and, below, the number in eight bits."""
    rng = np.random.default_rng(0)
    made = []
    for i in range(count):
        image = rng.integers(40, 60, (HEIGHT, WIDTH, 3), dtype=np.uint8) + np.uint8(i)
        image[:32, :48] = 255
        for bit in range(8):
            image[64:80, 16 * bit : 16 * (bit + 1)] = 255 * (i >> bit & 1)
        made.append(image)
    return made


def number_in(image: ImageArray) -> int:
    """The number that ``pictures`` put into the image."""
    return sum(int(image[68:76, 16 * bit + 4 : 16 * bit + 12].mean() > 128) << bit for bit in range(8))


def write_video(
    path: Path,
    images: Sequence[ImageArray],
    *,
    codec: str = "libx264",
    options: dict[str, str] | None = None,
    stamps_ms: Sequence[int] | None = None,
    display_degrees: int | None = None,
) -> Path:
    """Encode BGR images; without ``stamps_ms`` at 30 Hz. ``display_degrees``: rotation metadata, counter-clockwise."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30, options=options or {})
        assert isinstance(stream, VideoStream)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        if stamps_ms is not None:
            stream.codec_context.time_base = stream.time_base = Fraction(1, 1000)
        if display_degrees is not None:
            stream.set_display_rotation(display_degrees)
        for i, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = (
                (stamps_ms[i], Fraction(1, 1000)) if stamps_ms is not None else (i, Fraction(1, 30))
            )
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path
