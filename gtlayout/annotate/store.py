"""annotations.json while it is drawn: read and written frame by frame, so that nobody overwrites anybody."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gtlayout.annotate.entries import Entry, checked, digest, is_empty
from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import NATIVE_FILE
from gtlayout.io.annotations.frame_names import FrameFinder, Match
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.labels import FILE_NAME as LABELS_FILE
from gtlayout.io.annotations.labels import read_label_file
from gtlayout.io.annotations.native import FORMAT, read_annotations
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.io.sources import RawAnnotations, RawKeyFrame
from gtlayout.scene import Frame, KeyFrame


class ConflictError(Exception):
    """The frame is not what the page took it to be: somebody else has drawn in it since."""

    def __init__(self, entry: Entry | None) -> None:
        super().__init__("the frame was changed elsewhere")
        self.entry = entry


@dataclass(frozen=True)
class Drawn:
    """The file as it is now."""

    data: dict[str, Any]
    place: dict[int, int]
    """Frame (index into the scene's) → which of the file's entries draws on it."""
    not_shown: tuple[str, ...]
    """Entries that draw on no frame of the scene, and why; they stay in the file as they are."""
    unusable: dict[int, str]
    """Frames whose entry is damaged, and how; nothing can be drawn in them until the file is repaired."""

    def entry(self, frame: int) -> Entry | None:
        """What is drawn in a frame; None for nothing."""
        if frame not in self.place:
            return None
        found: Entry = self.data["frames"][self.place[frame]]
        return found


class Store:
    """The file ``annotations.json`` of a scene folder; it need not be there before the first save.

    Everything else in the file stays as it is: entries of other frames, drafts, keys that are not known here.
    """

    def __init__(self, root: Path, frames: Sequence[Frame]) -> None:
        self.path = root / NATIVE_FILE
        self._frames = frames
        self._lock = threading.RLock()
        self._read: tuple[tuple[int, int, int], Drawn] | None = None
        self._solvable: tuple[Drawn, tuple[tuple[KeyFrame, ...], tuple[str, ...]]] | None = None

    def read(self) -> Drawn:
        """What the file holds. Raises GtlayoutError when it cannot be read."""
        with self._lock:
            stamp = self._stamp()
            if self._read is None or self._read[0] != stamp:
                self._read = stamp, self._parsed()
            return self._read[1]

    def save(self, frame: int, entry: object, base: str) -> str:
        """Write what is drawn in a frame, if it is still what it was when the page got it. Returns its new digest.

        Args:
            frame: Index into the scene's frames.
            entry: Of the file's form; nothing drawn takes the frame out of it.
            base: Digest of the state that was drawn on.

        Raises:
            ConflictError: somebody else has changed the frame.
            GtlayoutError: the drawing is none, or the file cannot be read or written; it is then as it was.
        """
        made = checked(entry, self._frames[frame].name)
        with self._lock:
            drawn = self.read()
            if frame in drawn.unusable:
                raise GtlayoutError(f"{self.path}: {drawn.unusable[frame]}; repair it in the file first")
            before = drawn.entry(frame)
            if digest(before) != base:
                raise ConflictError(before)
            if before is not None:
                made["image"] = before["image"]  # as the file calls it
            entries = list(drawn.data["frames"])
            if frame in drawn.place:
                entries[drawn.place[frame]] = made
            else:
                after = [place for index, place in drawn.place.items() if index > frame]
                entries.insert(min(after, default=len(entries)), made)
            entries = [each for each in entries if each is not made or not is_empty(made)]
            write_json_atomic(self.path, {**drawn.data, "frames": entries})
            return digest(None if is_empty(made) else made)

    def key_frames(self) -> tuple[tuple[KeyFrame, ...], tuple[str, ...]]:
        """What a solve reads of the file, and what was repaired or left out; the same objects while it does not change.

        Raises GtlayoutError when it cannot be read.
        """
        with self._lock:
            drawn = self.read()
            if self._solvable is None or self._solvable[0] is not drawn:
                self._solvable = drawn, self._key_frames(drawn)
            return self._solvable[1]

    def _key_frames(self, drawn: Drawn) -> tuple[tuple[KeyFrame, ...], tuple[str, ...]]:
        if not any(isinstance(entry, dict) and entry.get("elements") for entry in drawn.data["frames"]):
            return (), ()
        raw = read_annotations(self.path.parent, self.path)
        own_labels = read_label_file(self.path.parent / LABELS_FILE)
        key_frames, warnings = build_key_frames(raw, self._frames, (), own_labels)
        return key_frames, (*raw.warnings, *warnings)

    def drafts(self) -> dict[int, Entry]:
        """What ``drafts`` of the file propose: frame → entry. What is none of the file's form is left out."""
        found = {}
        index = {frame.name: i for i, frame in enumerate(self._frames)}
        drafts = self.read().data.get("drafts", [])
        for draft in drafts if isinstance(drafts, list) else []:
            image = draft.get("image") if isinstance(draft, dict) else None
            if isinstance(image, str) and image in index:
                try:
                    found[index[image]] = checked(draft, image)
                except GtlayoutError:
                    continue
        return found

    def _stamp(self) -> tuple[int, int, int]:
        try:
            stat = self.path.stat()
        except OSError:
            return (0, 0, 0)
        return (stat.st_ino, stat.st_mtime_ns, stat.st_size)

    def _parsed(self) -> Drawn:
        if not self.path.exists():
            sizes = {(frame.camera.width, frame.camera.height) for frame in self._frames}
            size = [*sizes.pop()] if len(sizes) == 1 else None
            return Drawn({"format": FORMAT, "image_size": size, "frames": []}, {}, (), {})
        raw = read_annotations(self.path.parent, self.path)  # says what is wrong with the file as a whole
        data = read_json(self.path)
        self._require_own_size(data.get("image_size"))
        images = [entry.get("image") if isinstance(entry, dict) else None for entry in data["frames"]]
        named = tuple(RawKeyFrame(image, (), None) if isinstance(image, str) and image else None for image in images)
        find = FrameFinder(RawAnnotations(raw.path, tuple(filter(None, named))), self._frames, ())
        place: dict[int, int] = {}
        not_shown, unusable = [], {}
        for number, each in enumerate(named):
            match = find(each) if each is not None else "has no name"
            if not isinstance(match, Match):
                not_shown.append(f"annotated image {images[number]} {match}")
            elif match.index in place or match.index in unusable:
                not_shown.append(f"image {images[number]} is annotated twice, the first time counts")
            else:
                try:
                    self._require_own_image(match)
                    checked(data["frames"][number], self._frames[match.index].name)
                    place[match.index] = number
                except GtlayoutError as error:
                    unusable[match.index] = str(error)
        return Drawn(data, place, tuple(not_shown), unusable)

    def _require_own_image(self, match: Match) -> None:
        """Raises GtlayoutError when a drawing is of a video's frame, and the frame's own image differs from that."""
        frame = self._frames[match.index]
        if match.on_video and frame.origin is not None and frame.origin.resampled is not None:
            raise GtlayoutError(f"frame {frame.name} was drawn on the video, and not on the image that was made of it")

    def _require_own_size(self, size: object) -> None:
        """Raises GtlayoutError when the file's pixels are not those of the frames."""
        if size is not None and any([frame.camera.width, frame.camera.height] != size for frame in self._frames):
            raise GtlayoutError(
                f"{self.path} was drawn on images of {size} px, the frames are of another size: make a scene folder of "
                "one size with `gtlayout import DIR NEW`, and annotate that"
            )
