"""Which frame an annotated image is: one rule for all tools, in words on the page *Annotations* of the documentation.

A file is matched in one way as a whole. If all its images have numbers (a task over a video, a list of images that are
called by consecutive numbers), by the numbers of the video that the scene's frames come from, where that is known; else
by place, where as many images are here; else by the numbers in names, which is said. All other files: by name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gtlayout.io.annotations.scene_images import SceneImages
from gtlayout.io.annotations.sequence import AnnotatedSequence, number_of, sequence_of
from gtlayout.io.sources import RawAnnotations, RawKeyFrame
from gtlayout.scene import Frame, VideoOrigin


@dataclass(frozen=True)
class Match:
    """The frame that an annotated image is."""

    index: int
    """Into the scene's frames."""
    on_video: bool = False
    """Drawn on the frame as the video of ``Frame.origin`` shows it, not on the frame's image file."""


class FrameFinder:
    """Finds frames of a scene by what an annotation file calls them."""

    warnings: tuple[str, ...]
    """At most one line, without the file's name: which way the file was matched and why, if that is not certain."""

    def __init__(self, annotations: RawAnnotations, frames: Sequence[Frame], without_image: Sequence[str]) -> None:
        self._frames, self._key_frames = frames, annotations.key_frames
        self._images = SceneImages(frames, without_image)
        self._sequence = sequence_of(annotations)
        self._by_origin = {o.number: i for i, o in reversed([*enumerate(self._images.origins)]) if o is not None}
        self._frame_counts = {o.frame_count for o in self._images.origins if o is not None}
        self._order: list[int] = []
        self._way: Callable[[RawKeyFrame], Match | str] = self._by_name
        self.warnings = self._doubts() if self._sequence is None else self._decide(self._sequence)

    def __call__(self, raw: RawKeyFrame) -> Match | str:
        """The frame; or, in words that follow "annotated image …", why there is none."""
        return self._way(raw)

    def _decide(self, sequence: AnnotatedSequence) -> tuple[str, ...]:
        """Take the way of a sequence. Returns what is to be said of it."""
        images, length = self._images, sequence.length
        order = None
        if length is not None:
            by_letters = sequence.of_video is False
            order = images.in_order(length, by_letters=by_letters, evenly_numbered=sequence.are_names)
        origin = self._video_of(sequence, can_be_places=order is not None)
        if origin is not None:
            self._way = self._by_video
            if length == origin.frame_count or sequence.is_part_of_video:
                how = f"by their number in {origin.video_name}, of which the scene's frames were made"
                return self._contradicted(how)
            return (
                f"the video that was annotated has {length or 'an unknown number of'} frames, {origin.video_name} has "
                f"{origin.frame_count}: images are matched by their number in it",
            )
        if order is not None:
            self._order, self._way = order, self._by_place
            if sequence.of_video is False:
                return self._sorted_by_letters()
            return self._contradicted(f"by their place, because there are {length} images there and here")
        if sequence.of_video is False:
            self._way = self._by_nothing
            return ()
        return self._numbers_count_otherwise(sequence)

    def _numbers_count_otherwise(self, sequence: AnnotatedSequence) -> tuple[str, ...]:
        """Take the numbers in the names, which is a guess unless all are names of files that are here."""
        images = self._images
        if sequence.are_names and all((m := images.named(raw.image)) and m.exact for raw in self._key_frames):
            return ()
        self._way = self._by_number
        there = "an unknown number of" if sequence.length is None else sequence.length
        example = next((f", {raw.image} is {name}" for raw in self._key_frames if (name := self._called(raw))), "")
        first = "" if images.first_number is None else f"; those of the scene begin with {images.first_number}"
        return (
            f"its images are numbers of {there} frames, the scene has {images.file_count} images: they are matched by "
            f"the numbers in the names{example}{first}. Where numbers do not mean the same there and here, drawings "
            "are on wrong frames: look at them, or annotate the scene's own images",
        )

    def _video_of(self, sequence: AnnotatedSequence, *, can_be_places: bool) -> VideoOrigin | None:
        """The video that the numbers are of; None when it is not known, or is another one."""
        origins = [origin for origin in self._images.origins if origin is not None]
        if not sequence.video_numbers or len({o.video_name for o in origins}) != 1:
            return None
        if max(sequence.video_numbers.values()) >= origins[0].frame_count:
            return None
        if sequence.length == origins[0].frame_count or sequence.is_part_of_video:
            return origins[0]
        # As many as the scene has images: then they are of a video that was made of these.
        return None if can_be_places else origins[0]

    def _contradicted(self, how: str) -> tuple[str, ...]:
        """Says that names would lead elsewhere, if they do."""
        for raw in self._key_frames:
            named = self._named_or_numbered(raw.image)
            found = self._way(raw)
            if named is None or not isinstance(found, Match) or named == found.index:
                continue
            return (
                f"images are matched {how}; so {raw.image} is {self._frames[found.index].name}, although it is "
                f"called like {self._images.names[named]}",
            )
        return ()

    def _sorted_by_letters(self) -> tuple[str, ...]:
        natural_order = self._images.in_order(len(self._order), by_letters=False, evenly_numbered=False)
        if natural_order == self._order:
            return ()
        first, second = (self._images.names[place] for place in self._order[:2])
        return (
            f"its images are numbers without names: they are taken to be sorted as CVAT does, by letters ({first}, "
            f"{second} …); export as 'CVAT for images 1.1', which names them",
        )

    def _doubts(self) -> tuple[str, ...]:
        """What is to be said of a file that is matched by name."""
        lines = []
        if loose := [raw for raw in self._key_frames if self._is_by_number_alone(raw)]:
            lines.append(f"{len(loose)} images are matched by their numbers alone, first {self._pair(loose[0])}")
        elsewhere = [
            raw
            for raw in self._key_frames
            if self._images.folders > 1
            and (match := self._images.named(raw.image))
            and match.other_folder
            and isinstance(self._by_name(raw), Match)
        ]
        if elsewhere:
            lines.append(
                f"{len(elsewhere)} images are matched although they lie in other folders, first "
                f"{self._pair(elsewhere[0])}"
            )
        return ("; ".join(lines),) if lines else ()

    def _pair(self, raw: RawKeyFrame) -> str:
        return f"{raw.image} is {self._called(raw)}"

    def _called(self, raw: RawKeyFrame) -> str | None:
        found = self._way(raw)
        return self._frames[found.index].name if isinstance(found, Match) else None

    def _is_by_number_alone(self, raw: RawKeyFrame) -> bool:
        return self._images.named(raw.image) is None and isinstance(self._by_name(raw), Match)

    def _by_name(self, raw: RawKeyFrame) -> Match | str:
        match = self._images.named(raw.image)
        if match is None:
            number = number_of(raw.image)
            if number is not None and number < max(self._frame_counts, default=0):
                return self._frame_of_video(number)
            place = self._images.numbered(raw.image)
            return "has no camera" if place is None else self._image(place)
        if len(match.places) > 1:
            names = " or ".join(self._images.names[place] for place in match.places[:2])
            return f"may be {names}: write its folder as it is there"
        return self._image(match.places[0])

    def _by_number(self, raw: RawKeyFrame) -> Match | str:
        place = self._named_or_numbered(raw.image)
        return "has a number that no image of the scene has" if place is None else self._image(place)

    def _named_or_numbered(self, image: str) -> int | None:
        match = self._images.named(image)
        if match is None:
            return self._images.numbered(image)
        return match.places[0] if len(match.places) == 1 else None

    def _by_place(self, raw: RawKeyFrame) -> Match | str:
        assert self._sequence is not None
        place = self._sequence.places.get(raw.image)
        if place is None or place >= len(self._order):
            return f"is none of the {len(self._order)} images that its file counts"
        found = self._image(self._order[place])
        return f"({self._images.names[self._order[place]]}) {found}" if isinstance(found, str) else found

    def _by_nothing(self, raw: RawKeyFrame) -> Match | str:
        assert self._sequence is not None
        return (
            f"is known by its place among {self._sequence.length or 'an unknown number of'} images only, the scene has "
            f"{self._images.file_count}: export as 'CVAT for images 1.1', which names them"
        )

    def _by_video(self, raw: RawKeyFrame) -> Match | str:
        assert self._sequence is not None
        return self._frame_of_video(self._sequence.video_numbers[raw.image])

    def _frame_of_video(self, number: int) -> Match | str:
        if number in self._by_origin:
            index = self._by_origin[number]
            return Match(index, on_video=self._frames[index].video is None)
        nearest = min(self._by_origin, key=lambda other: (abs(other - number), other))
        index = self._by_origin[nearest]
        video = self._images.origins[index]
        assert video is not None
        return (
            f"is frame {number} of {video.video_name}, which is no frame of the scene; the nearest is frame {nearest}, "
            f"{self._frames[index].name}"
        )

    def _image(self, place: int) -> Match | str:
        return self._images.missing(place) or Match(place)
