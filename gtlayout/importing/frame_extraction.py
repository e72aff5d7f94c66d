"""From a video file to a folder of images: the sharpest frame of every stretch of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import cv2

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import write_atomic
from gtlayout.io.pixels.video import Video
from gtlayout.io.video_record import origin_in
from gtlayout.scene import FloatArray, ImageArray, VideoOrigin

JPEG_QUALITY = 95
SHARPNESS_PX = 640
"""Sharpness is judged on images no longer than this: finer detail is mostly noise and coding."""
ON_THE_EDGE = 1e-6
"""A frame this share of a window before its end belongs to the next: presentation times are rounded."""


@dataclass(frozen=True)
class Extraction:
    """The images taken from a video."""

    names: tuple[str, ...]
    """File names in the order of time; ``time_of`` reads them."""
    origins: tuple[VideoOrigin, ...]
    """Which frame of the video each of them is."""
    warnings: tuple[str, ...]

    @property
    def video_frames(self) -> tuple[int, ...]:
        """Numbers of the frames in the video."""
        return tuple(origin.number for origin in self.origins)


def extract_frames(
    video: Path,
    folder: Path,
    rate_hz: float,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
    annotated: Collection[int] = (),
) -> Extraction:
    """Write the sharpest frame of each 1 / ``rate_hz`` seconds of ``video`` into ``folder`` (made if absent).

    In a stretch with frames whose numbers are in ``annotated``, these are written instead. A video with fewer frames a
    second gives all it has. Two frames at a time are held. ``progress`` is called with (frames seen, frames in all).
    Raises GtlayoutError when the rate is no positive number, the video cannot be read, or the folder cannot be written.
    """
    if not 0 < rate_hz < math.inf:
        raise GtlayoutError(f"frames per second must be a positive number, not {rate_hz}")
    source = Video(video)
    times_s = source.times_s
    names: list[str] = []
    chosen: list[int] = []
    seen = 0

    def counted() -> Iterator[tuple[int, ImageArray]]:
        nonlocal seen
        for frame in source.frames():
            seen += 1
            yield frame

    for index, image in _taken(counted(), times_s, rate_hz, frozenset(annotated)):
        names.append(frame_name(float(times_s[index])))
        chosen.append(index)
        write_atomic(folder / names[-1], _jpeg(image))
        progress(index + 1, len(times_s))
    if not names:
        raise GtlayoutError(f"{video}: no frame can be decoded")
    progress(len(times_s), len(times_s))
    lost = len(times_s) - seen
    warnings = (f"{video}: {lost} of {len(times_s)} frames cannot be decoded and were passed over",) if lost else ()
    return Extraction(tuple(names), tuple(origin_in(source, index) for index in chosen), warnings)


def frame_name(time_s: float) -> str:
    """``000012345678.jpg`` for 12.345678 s: microseconds, so that names sort by time."""
    return f"{round(time_s * 1e6):012d}.jpg"


def time_of(name: str) -> float | None:
    """Seconds within the video that ``frame_name`` wrote into a name; None for any other name."""
    stem = Path(name).stem
    return int(stem) / 1e6 if len(stem) >= 12 and stem.isascii() and stem.isdecimal() else None


def sharpness(image: ImageArray) -> float:
    """Variance of the Laplacian of an (H, W, 3) BGR image, grey and reduced; comparable for one scene and size."""
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    shrink = SHARPNESS_PX / max(gray.shape)
    if shrink < 1:
        gray = cv2.resize(gray, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(gray, cv2.CV_32F).var())


def _taken(
    frames: Iterator[tuple[int, ImageArray]], times_s: FloatArray, rate_hz: float, annotated: Collection[int]
) -> Iterator[tuple[int, ImageArray]]:
    """Index and pixels of the frames of each window that are annotated, else of its sharpest."""
    for _, window in groupby(frames, key=lambda frame: math.floor(times_s[frame[0]] * rate_hz + ON_THE_EDGE)):
        best: tuple[int, ImageArray] | None = None
        most, has_annotated = -1.0, False
        for index, image in window:
            if index in annotated:
                has_annotated = True
                yield index, image
            elif (found := sharpness(image)) > most:
                most, best = found, (index, image)
        if best is not None and not has_annotated:
            yield best


def _jpeg(image: ImageArray) -> bytes:
    ok, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not ok:
        raise GtlayoutError(f"a frame of {image.shape[1]}x{image.shape[0]} px is too large for JPEG")
    return data.tobytes()
