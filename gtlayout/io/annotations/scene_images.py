"""The images of a scene by name, place and number, to be found by what annotation files call them."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from contextlib import suppress
from pathlib import PurePosixPath

from gtlayout.io.annotations.sequence import counts_evenly, number_of
from gtlayout.io.cameras.frames import natural
from gtlayout.io.image_names import NameIndex, NameMatch, parts_of, stem
from gtlayout.scene import Frame, VideoOrigin

LAST_NUMBER = re.compile(r".*?(\d{1,18})\D*", re.DOTALL)


class SceneImages:
    """Frames; image files beside theirs, which have no camera; cameras without an image file: in this order.

    Those that are no frame are there to be recognised: an image that is one of them is not the next best frame.
    """

    def __init__(self, frames: Sequence[Frame], without_image: Sequence[str]) -> None:
        beside = _beside(frames)
        self.frame_count, self.file_count = len(frames), len(frames) + len(beside)
        self.names = (*(frame.name for frame in frames), *beside, *without_image)
        self.origins = tuple(map(_origin, frames))
        self.folders = len({parts_of(name)[:-1] for name in self.names})
        self._index = NameIndex(self.names)
        self._by_number: dict[int, list[int]] = defaultdict(list)
        for place, name in enumerate(self.names):
            if match := LAST_NUMBER.fullmatch(stem(name)):
                self._by_number[int(match[1])].append(place)

    @property
    def first_number(self) -> int | None:
        """The lowest number in the name of an image; None where no name has any."""
        return min(self._by_number, default=None)

    def missing(self, place: int) -> str | None:
        """What the image lacks to be a frame, in words."""
        if place < self.frame_count:
            return None
        return "has no camera" if place < self.file_count else "has no image file"

    def named(self, wanted: str) -> NameMatch | None:
        """The images that answer best to a name."""
        return self._index.find(wanted)

    def numbered(self, wanted: str) -> int | None:
        """The one image with the last number that ``wanted`` is, where that is but a number."""
        number = number_of(wanted)
        found = [] if number is None else self._by_number.get(number, [])
        return found[0] if len(found) == 1 else None

    def in_order(self, length: int, *, by_letters: bool, evenly_numbered: bool) -> list[int] | None:
        """The ``length`` images, if there are so many, with or without those that lack something.

        By the numbers in their names or, as CVAT sorts what is uploaded, by their letters alone. ``evenly_numbered``:
        only where they, too, are called by numbers that count evenly.
        """
        for count in (self.file_count, self.frame_count, len(self.names)):
            if count != length:
                continue
            order = sorted(range(count), key=lambda place: natural(self.names[place]))
            numbers = [number_of(self.names[place]) for place in order]
            known = [number for number in numbers if number is not None]
            if not evenly_numbered or (len(known) == count and counts_evenly(known)):
                return sorted(order, key=lambda place: self.names[place]) if by_letters else order
        return None


def _beside(frames: Sequence[Frame]) -> list[str]:
    """Names of the image files in the folders of the frames' own, of their kinds, called as the frames are."""
    on_disk = [frame for frame in frames if frame.video is None]
    folders = {frame.image_path.parent: PurePosixPath(frame.name).parent for frame in on_disk}
    endings = {frame.image_path.suffix.casefold() for frame in on_disk}
    own = {frame.image_path for frame in on_disk}
    names = []
    for folder, called in folders.items():
        with suppress(OSError):  # Nothing is beside what cannot be listed.
            names += [
                (called / path.name).as_posix()
                for path in folder.iterdir()
                if path not in own and path.suffix.casefold() in endings
            ]
    return sorted(names, key=natural)


def _origin(frame: Frame) -> VideoOrigin | None:
    """What a frame was made of; where the pixels are read from a video, that is it."""
    if frame.video is None:
        return frame.origin
    video, index = frame.video.video, frame.video.index
    return VideoOrigin(video.path.name, index, float(video.times_s[index]), len(video.times_s))
