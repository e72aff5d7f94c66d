"""What an annotation file numbers: the frames of a task over a video, or images that are called by numbers alone."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from gtlayout.io.image_names import originals, parts_of, stem
from gtlayout.io.sources import RawAnnotations

NUMBER = re.compile(r"(?:frame_?)?(\d{1,18})", re.IGNORECASE)
"""A name that is nothing but a number; CVAT and others put ``frame_`` before it."""
VIDEO_FRAME = re.compile(r"frame_(\d{6,9})")
"""What CVAT calls a frame of a video: by its number there, from 0 on."""


@dataclass(frozen=True)
class AnnotatedSequence:
    """The images of a file, all of which have numbers."""

    length: int | None
    """How many there are, annotated or not; None = not known."""
    of_video: bool | None
    """As in ``RawAnnotations``."""
    is_part_of_video: bool
    """Whether they are some of a video's frames, and numbered as there."""
    are_names: bool
    """Whether the numbers are names of image files, so that they mean something where these files are."""
    places: Mapping[str, int]
    """By what the file calls an image: its place among them, from 0 on."""
    video_numbers: Mapping[str, int]
    """By what the file calls an image: its number in the video; empty when they are of no video."""


def sequence_of(annotations: RawAnnotations) -> AnnotatedSequence | None:
    """The sequence that the file is over; None when a key frame has no number, or names are more than numbers.

    Of a list of names they must count evenly, as they do when it is complete.
    """
    key_frames = annotations.key_frames
    places = {raw.image: raw.number for raw in key_frames if raw.number is not None}
    in_video = {raw.image: raw.video_number for raw in key_frames if raw.video_number is not None}
    if key_frames and all(raw.image in places or raw.image in in_video for raw in key_frames):
        known = in_video if len(in_video) == len({raw.image for raw in key_frames}) else {}
        return AnnotatedSequence(
            annotations.sequence_length, annotations.of_video, annotations.is_part_of_video, False, places, known
        )
    if annotations.sequence_length not in (None, len(annotations.listed)):
        return None
    numbers = {name: number for name in annotations.listed if (number := number_of(name)) is not None}
    if not key_frames or len(numbers) < len(set(annotations.listed)) or not counts_evenly(list(numbers.values())):
        return None
    if not all(raw.image in numbers for raw in key_frames):
        return None
    in_order = sorted(numbers, key=lambda name: numbers[name])
    of_video = all(VIDEO_FRAME.fullmatch(stem(parts_of(name)[-1])) for name in in_order)
    places = {name: place for place, name in enumerate(in_order)}
    return AnnotatedSequence(len(in_order), None, False, True, places, numbers if of_video else {})


def number_of(name: str) -> int | None:
    """The number that an image is called by, apart from what a tool added; None when its name is more than that."""
    file = (parts_of(name) or ("",))[-1]
    matches = (NUMBER.fullmatch(stem(form)) for form in (file, *originals(file)))
    return next((int(match[1]) for match in matches if match), None)


def counts_evenly(numbers: Sequence[int]) -> bool:
    """Whether there are two numbers at least, all different, and from each to the next it is equally far."""
    in_order = sorted(numbers)
    steps = {after - before for before, after in pairwise(in_order)}
    return len(steps) == 1 and 0 not in steps
