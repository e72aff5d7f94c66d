"""Small videos, made with PyAV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.stream import VideoStream

from gtlayout.scene import FloatArray, ImageArray

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


def cvat_video(polygons: Mapping[int, FloatArray], size: tuple[int, int], count: int) -> str:
    """A task over a video as CVAT writes it ("CVAT for video 1.1"): one polygon in each of some frames."""
    tracks = "".join(
        f'<track id="{i}" label="wall" source="manual"><polygon frame="{number}" keyframe="1" outside="0" occluded="0" '
        f'points="{";".join(f"{x:.6f},{y:.6f}" for x, y in points)}" z_order="0"/></track>'
        for i, (number, points) in enumerate(polygons.items())
    )
    return (
        f"<annotations><version>1.1</version><meta><task><size>{count}</size><mode>interpolation</mode>"
        f"<start_frame>0</start_frame><stop_frame>{count - 1}</stop_frame><frame_filter></frame_filter><original_size>"
        f"<width>{size[0]}</width><height>{size[1]}</height></original_size></task></meta>{tracks}</annotations>"
    )
