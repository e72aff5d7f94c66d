"""CVAT's own XML, "CVAT for images 1.1" and "CVAT for video 1.1", read.

Facts are from CVAT's documentation ("XML annotation format") and its exporter (``cvat/apps/dataset_manager``:
``formats/cvat.py``, ``bindings.py``)."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element as Node

from defusedxml import DefusedXmlException
from defusedxml import ElementTree as DefusedTree

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import files_of_kind
from gtlayout.io.annotations.checked import CURVED, Notes, UnusableError, is_curved
from gtlayout.io.annotations.cvat.shapes import geometry, whole_number
from gtlayout.io.annotations.sequence import VIDEO_FRAME
from gtlayout.io.archives import read_bytes
from gtlayout.io.sources import RawAnnotations, RawKeyFrame, RawShape, Reader

MODES = {"interpolation": True, "annotation": False}
"""What CVAT calls tasks over a video and over images: whether it is a video."""
PROPOSED = "proposed"
"""The tag of an image whose shapes are proposals that nobody has confirmed: who confirms them removes it."""


@dataclass(frozen=True)
class _Sequence:
    """The images of a task or job: CVAT numbers them by where they lie in the video or folder they were taken from."""

    length: int | None = None
    start: int = 0
    step: int = 1
    size: tuple[int, int] | None = None
    """(width, height) px of a video."""
    of_video: bool | None = None
    is_job: bool = False

    def number(self, frame: int) -> int | None:
        """Place of CVAT's frame number among the images of the task or job, from 0."""
        place, off = divmod(frame - self.start, self.step)
        return place if not off and place >= 0 else None

    def video_number(self, frame: int) -> int | None:
        """Number in the video of CVAT's frame number, which is the same."""
        return None if self.of_video is False else frame

    @property
    def is_part_of_video(self) -> bool:
        """Whether it leaves frames out as far as the file tells; it does not tell how many there are."""
        return bool(self.of_video) and (self.start > 0 or self.step > 1 or self.is_job)


def read_cvat(_root: Path, path: Path) -> RawAnnotations:
    """Read an export of a task or job; images without a shape, or tagged as proposed, are no key frames.

    Of tracks, key frames are those in which a shape was drawn: there interpolated shapes of other tracks count.
    ``RawKeyFrame.number`` counts the images of the task or job. Shapes that are broken or of another type are dropped.
    There is a warning for each kind of what was left out or interpolated. Raises GtlayoutError when the file is no such
    XML, or declares a document type or entities.
    """
    root = _parse(path)
    sequence, notes, proposed = _sequence(root), Notes(), Notes()
    of_images = _images(root, sequence, notes, proposed)
    of_tracks = _tracks(root, sequence, notes)
    listed = tuple(name for image in root.findall("image") if (name := _line(image.get("name", ""))))
    return RawAnnotations(
        path,
        (*of_images, *of_tracks),
        tuple(notes.lines(path.name)),
        sequence.length,
        sequence.of_video,
        sequence.is_part_of_video,
        listed,
        tuple(proposed.lines(path.name)),
    )


def _parse(path: Path) -> Node:
    content = read_bytes(path)
    try:
        root = DefusedTree.fromstring(content, forbid_dtd=True)
    except DefusedXmlException as error:
        raise GtlayoutError(f"{path} declares a document type or entities, which CVAT never does: not read") from error
    except (DefusedTree.ParseError, ValueError, LookupError) as error:  # the last two: encodings
        raise GtlayoutError(f"{path} is not valid XML: {error}") from error
    if root is None or root.tag != "annotations":
        raise GtlayoutError(f"{path} is no CVAT file: its outermost element is not <annotations>")
    return root


def _sequence(root: Node) -> _Sequence:
    """Of a project, which has several tasks, nothing is known."""
    about = [node for tag in ("task", "job") for node in root.findall(f"meta//{tag}")]
    if len(about) != 1:
        return _Sequence()
    step = re.search(r"step\s*=\s*(\d{1,9})", about[0].findtext("frame_filter") or "")
    width, height = (whole_number(about[0].findtext(f"original_size/{side}")) for side in ("width", "height"))
    mode = (about[0].findtext("mode") or "").strip()
    return _Sequence(
        whole_number(about[0].findtext("size")),
        whole_number(about[0].findtext("start_frame")) or 0,
        max(int(step[1]), 1) if step else 1,
        (width, height) if width and height else None,
        MODES.get(mode),
        about[0].tag == "job",
    )


def _numbers(sequence: _Sequence, frame: int) -> tuple[int | None, int | None]:
    """Place among the images of the task or job, and number in the video."""
    return sequence.number(frame), sequence.video_number(frame)


def _images(root: Node, sequence: _Sequence, notes: Notes, proposed: Notes) -> list[RawKeyFrame]:
    key_frames = []
    for image in root.findall("image"):
        name, size = _line(image.get("name", "")), (whole_number(image.get("width")), whole_number(image.get("height")))
        if not name or (size != (None, None) and not all(size)):
            notes.add(
                "image skipped: its name is missing or its size broken", name or _line(f"image {image.get('id')}")
            )
            continue
        if any(node.tag == "tag" and node.get("label") == PROPOSED for node in image):
            proposed.add(f"image left out: its tag {PROPOSED!r} says that nobody has confirmed what is drawn", name)
            continue
        width, height = size
        annotated = (width, height) if width and height else None
        shapes = [_shape(node, None, name, notes) for node in image if node.get("outside") != "1"]
        video = VIDEO_FRAME.fullmatch(name)
        numbers = _numbers(sequence, int(video[1])) if video else (None, None)
        if found := tuple(shape for shape in shapes if shape is not None):
            key_frames.append(RawKeyFrame(name, found, annotated, *numbers))
    return key_frames


def _tracks(root: Node, sequence: _Sequence, notes: Notes) -> list[RawKeyFrame]:
    """Key frames, in order. A project's tasks are kept apart."""
    there: dict[tuple[str, int], list[tuple[Node, Node]]] = defaultdict(list)
    drawn: set[tuple[str, int]] = set()
    for track in root.findall("track"):
        where = _line(f"track {track.get('id')}")
        for node in track:
            frame = whole_number(node.get("frame"))
            if frame is None:
                notes.add("shape of a track skipped: its frame number is broken", where)
            elif node.get("outside") != "1":  # With an outside shape CVAT ends a track: there is nothing in this frame.
                there[track.get("task_id", ""), frame].append((track, node))
                if node.get("keyframe") == "1":
                    drawn.add((track.get("task_id", ""), frame))
    for _, frame in sorted(set(there) - drawn):
        notes.add("frame left out: all its shapes were interpolated by CVAT, none drawn", _frame_name(frame))
    key_frames = []
    for task, frame in sorted(drawn):
        image = _frame_name(frame)
        shapes = []
        for track, node in there[task, frame]:
            if (shape := _shape(node, track, image, notes)) is not None:
                shapes.append(shape)
                if node.get("keyframe") != "1":
                    notes.add("shape in a key frame was interpolated by CVAT, not drawn: check it", image)
        if shapes:
            key_frames.append(RawKeyFrame(image, tuple(shapes), sequence.size, *_numbers(sequence, frame)))
    return key_frames


def _frame_name(frame: int) -> str:
    """As CVAT writes frames of a video where it names them."""
    return f"frame_{frame:06d}"


def _shape(node: Node, track: Node | None, where: str, notes: Notes) -> RawShape | None:
    """None when it is left out. Label and group are the track's, if it is of one.

    So is an id where none is written, unless the track is grouped: parts of an element are told by their group then.
    """
    owner = node if track is None else track
    try:
        polygons, lines = geometry(node)
        z_order = int(node.get("z_order", 0))
        if not (label := _line(owner.get("label", "")).strip()):
            raise UnusableError("it has no label")
    except UnusableError as error:
        notes.add(f"{node.tag} skipped: {error}", where)
        return None
    except (ValueError, OverflowError, TypeError):
        notes.add(f"{node.tag} skipped: a number is missing or broken", where)
        return None
    attributes = {
        each.get("name", "").casefold(): _line(each.text or "").strip() for each in node.iterfind("attribute")
    }
    group = _line(owner.get("group_id", "")).strip().removeprefix("0") or None  # 0 is no group
    of_track = None if track is None or group else _line(f"track_{track.get('id')}")
    return RawShape(
        label,
        polygons,
        lines,
        id=attributes.get("id") or of_track,
        element=attributes.get("element") or None,
        group=group,
        z_order=z_order,
        curved=is_curved(attributes.get(CURVED), notes, where),
    )


def _line(text: str) -> str:
    """What is quoted in messages must not break their line."""
    return re.sub(r"\s", " ", text)


READER = Reader("CVAT", "CVAT's annotations.xml", files_of_kind("cvat"), read_cvat)
