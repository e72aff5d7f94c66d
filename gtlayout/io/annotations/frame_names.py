"""Which frame an annotated image is. Tools identify it by its path, its name, its stem or its number."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import PurePosixPath

from gtlayout.io.sources import RawAnnotations, RawKeyFrame
from gtlayout.scene import Frame

NAMES: tuple[Callable[[str], str], ...] = (
    lambda name: name,
    lambda name: PurePosixPath(name).name,
    lambda name: PurePosixPath(name).stem,
)
"""What two names are compared by, the most telling first. CVAT names a video's frames without an ending."""
VIDEO_FRAME = re.compile(r"frame_(\d{6,9})")
"""What CVAT calls a frame of a video: by its number there."""


class FrameFinder:
    """Finds frames of a scene by what an annotation file calls them."""

    def __init__(self, annotations: RawAnnotations, frames: Sequence[Frame], without_image: Sequence[str]) -> None:
        self._sequence_length = annotations.sequence_length
        self._frames = frames
        self._by_name: tuple[dict[str, list[int]], ...] = tuple(defaultdict(list) for _ in NAMES)
        for index, frame in enumerate(frames):
            for short, found in zip(NAMES, self._by_name, strict=True):
                found[short(frame.name)].append(index)
        self._by_video_index = {frame.video.index: i for i, frame in enumerate(frames) if frame.video is not None}
        self._without_image = {PurePosixPath(name).name for name in without_image}

    def __call__(self, raw: RawKeyFrame) -> int | str:
        """Index of the frame; or, in words, why there is none."""
        wanted = raw.image.replace("\\", "/").removeprefix("./").removeprefix("images/")
        for short, by_name in zip(NAMES, self._by_name, strict=True):
            found = by_name.get(short(wanted), [])
            if len(found) == 1:
                return found[0]
            if found:
                names = " and ".join(self._frames[index].name for index in found[:2])
                return f"may be {names}; write its folder, too"
        of_video = VIDEO_FRAME.fullmatch(wanted)
        if of_video and int(of_video[1]) in self._by_video_index:
            return self._by_video_index[int(of_video[1])]
        if raw.number is not None and self._sequence_length == len(self._frames) and raw.number < len(self._frames):
            return raw.number
        return f"has no {'image file' if PurePosixPath(wanted).name in self._without_image else 'camera'}"
