"""The images, or the frames of a video, that cameras with timestamps belong to."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.timestamps import common_offset_s, distances_s, match_times
from gtlayout.io.pixels.images import size_of_first
from gtlayout.io.pixels.video import EXTENSIONS, Video
from gtlayout.scene import FloatArray, IntArray, VideoFrame

TOLERANCE_S = 0.003
"""Between a camera's timestamp and that in an image's name."""
TIMED_NAME = re.compile(r"(?:(.*)_)?(\d{1,18})")
"""``<timestamp>`` or ``<video>_<timestamp>``, in microseconds, without the extension."""
MAX_TIMESTAMP_US = 1 << 53
"""Whole numbers beyond are not exact in floating point."""
IMAGE_EXTENSIONS = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True)
class TimedImages:
    """What was found for each of N timestamps."""

    paths: tuple[Path, ...]
    """(N,) the image file; what it would be called where there is none."""
    video_frames: tuple[VideoFrame | None, ...]
    """(N,) the frame of the video; all None where there are image files."""
    size: tuple[int, int]
    """(width, height) px of the images or the video."""
    warnings: tuple[str, ...]


def find_timed_images(
    root: Path, folders: Sequence[Path], names: Sequence[str], timestamps_us: Sequence[int], camera_file: Path
) -> TimedImages:
    """Match N timestamps of ``camera_file`` with images in the first of ``folders`` that has any of them, else with the
    one video file in the scene folder ``root``.

    Images, called ``<timestamp>`` or ``<video>_<timestamp>``, match within 3 ms, frames of a video within half the time
    from one to the next; none is given to two cameras. ``names``: N file names for what has no image file.
    Raises GtlayoutError, naming ``camera_file``, when nothing matches, no image can be read, or there are two videos.
    """
    for timestamp in timestamps_us:
        if abs(timestamp) >= MAX_TIMESTAMP_US:
            raise GtlayoutError(f"{camera_file}: {timestamp} is no timestamp in microseconds")
    wanted_s = np.asarray(timestamps_us, dtype=np.float64) / 1e6
    would_be = [folders[0] / name for name in names]
    hints = []
    for folder in folders:
        files = _of_one_video(_timed_files(folder), wanted_s)
        available_s = np.array([us for us, _ in files], dtype=np.float64) / 1e6
        matches = match_times(wanted_s, available_s, TOLERANCE_S)
        doubts = _doubts(wanted_s, available_s, matches, TOLERANCE_S, f"images in {folder}", camera_file)
        paths = tuple(files[i][1] if i >= 0 else path for i, path in zip(matches, would_be, strict=True))
        size = size_of_first([path for i, path in zip(matches, paths, strict=True) if i >= 0])
        if size is not None:
            return TimedImages(paths, (None,) * len(paths), size, tuple(doubts))
        hints += doubts
    videos = _videos(root)
    if len(videos) > 1:
        raise GtlayoutError(f"{camera_file}: more than one video: {', '.join(map(str, videos))}; leave one of them")
    if videos:
        return _from_video(Video(videos[0]), would_be, wanted_s, camera_file)
    where = f"{would_be[0]} and so on, within 3 ms, or one video ({', '.join(EXTENSIONS)}) in {root}"
    raise GtlayoutError(
        f"{camera_file}: no image that can be read for any of {len(names)} frames; looked for {where}"
        + "".join(f" ({hint})" for hint in hints[:1])
    )


def _from_video(video: Video, paths: Sequence[Path], wanted_s: FloatArray, camera_file: Path) -> TimedImages:
    tolerance_s = max(video.interval_s / 2, TOLERANCE_S)
    matches = match_times(wanted_s, video.times_s, tolerance_s)
    warnings = _doubts(wanted_s, video.times_s, matches, tolerance_s, f"frames of {video.path}", camera_file)
    found = matches >= 0
    if not found.any():
        raise GtlayoutError(
            f"{camera_file}: no frame of {video.path} is at the time of any of {len(paths)} cameras, which are from "
            f"{wanted_s.min():.3f} to {wanted_s.max():.3f} s; the video ends at {video.times_s[-1]:.3f} s"
            + "".join(f" ({hint})" for hint in warnings[:1])
        )
    offset_s = float(np.median(video.times_s[matches[found]] - wanted_s[found]))
    if abs(offset_s) > TOLERANCE_S:
        warnings.append(
            f"{camera_file}: frames of {video.path} are {1000 * offset_s:.1f} ms off the cameras' timestamps (median)"
        )
    frames = tuple(VideoFrame(video, int(i)) if i >= 0 else None for i in matches)
    return TimedImages(tuple(paths), frames, (video.width, video.height), tuple(warnings))


def _doubts(
    wanted_s: FloatArray, available_s: FloatArray, matches: IntArray, tolerance_s: float, what: str, camera_file: Path
) -> list[str]:
    """Why some cameras match nothing, where that can be told."""
    lost = np.flatnonzero(matches < 0)
    if not len(lost) or not len(available_s):
        return []
    doubts = []
    share = f"{len(lost)} of {len(wanted_s)} cameras have none within {1000 * tolerance_s:.3g} ms"
    offset_s = common_offset_s(wanted_s, available_s, tolerance_s)
    if offset_s is not None:
        off = f"{1000 * offset_s:.0f} ms" if abs(offset_s) < 1 else f"{offset_s:.3f} s"
        doubts.append(f"{camera_file}: timestamps are off by about {off} from the {what}: {share}")
    rivals = np.count_nonzero(distances_s(wanted_s[lost], available_s) <= tolerance_s)
    if rivals:
        doubts.append(f"{camera_file}: {rivals} cameras are left out: another is nearer to the same of the {what}")
    return doubts


def _timed_files(folder: Path) -> list[tuple[str, int, Path]]:
    """(video, timestamp in µs, path) of the images in a folder, by name."""
    files = []
    for path in sorted(folder.iterdir()) if folder.is_dir() else []:
        match = TIMED_NAME.fullmatch(path.stem)
        if match and path.suffix.lower() in IMAGE_EXTENSIONS and path.is_file():
            files.append((match[1] or "", int(match[2]), path))
    return files


def _of_one_video(files: Sequence[tuple[str, int, Path]], wanted_s: FloatArray) -> list[tuple[int, Path]]:
    """Timestamps and paths of those that match best: a folder may hold the images of several videos."""
    by_video: dict[str, list[tuple[int, Path]]] = defaultdict(list)
    for video, us, path in files:
        by_video[video].append((us, path))

    def matched(group: list[tuple[int, Path]]) -> int:
        times_s = np.array([us for us, _ in group], dtype=np.float64) / 1e6
        return int(np.count_nonzero(match_times(wanted_s, times_s, TOLERANCE_S) >= 0))

    return max(by_video.values(), key=matched, default=[])


def _videos(root: Path) -> list[Path]:
    return sorted(path for path in root.iterdir() if path.suffix.lower() in EXTENSIONS and path.is_file())
