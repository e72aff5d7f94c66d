"""The native annotation file ``annotations.json``, format ``gtlayout-annotations/1``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import NATIVE_FILE, files_of_kind
from gtlayout.io.annotations.checked import CURVED, MAX_PX, Notes, UnusableError, is_curved, name, pairs
from gtlayout.io.annotations.drafts import Draft, as_drawn
from gtlayout.io.annotations.masks import simple_rings
from gtlayout.io.annotations.outlines import View
from gtlayout.io.files import printable, read_json, write_json_atomic
from gtlayout.io.sources import RawAnnotations, RawKeyFrame, RawShape, Reader
from gtlayout.scene import FloatArray, Frame, KeyFrame

FORMAT = "gtlayout-annotations/1"
DRAFT_FORMAT = "gtlayout-drafts/1"
DRAFTS = "drafts"
"""Where an annotation file keeps what is only proposed: entries like those of ``frames``."""


def read_annotations(_root: Path, path: Path) -> RawAnnotations:
    """Read the file; geometry is left as drawn.

    What has the wrong type, is no finite number, or an element with the id of another of its frame is dropped with a
    warning per kind: a line, an element, a frame. Raises GtlayoutError naming the file when it has another format, or
    no list of frames.
    """
    data = read_json(path)
    if data.get("format") != FORMAT:
        raise GtlayoutError(f"{path}: format is {data.get('format')!r}, expected {FORMAT!r}")
    size = _image_size(data.get("image_size"), path)
    frames = data.get("frames")
    if not isinstance(frames, list):
        raise GtlayoutError(f"{path}: frames must be a list" + ("" if "frames" in data else ", it is missing"))
    notes = Notes()
    key_frames = [_key_frame(frame, i, size, notes) for i, frame in enumerate(frames)]
    drafts = _list(data, DRAFTS, path.name, notes)
    are = "frame is a draft" if len(drafts) == 1 else "frames are drafts"
    left = f"{path.name}: {len(drafts)} {are}, not used: only what a person confirmed counts"
    drawn = tuple(filter(None, key_frames))
    return RawAnnotations(path, drawn, tuple(notes.lines(path.name)), notes=(left,) if drafts else ())


def write_annotations(path: Path, frames: Sequence[Frame], key_frames: Sequence[KeyFrame]) -> None:
    """Write ``key_frames`` (indices into ``frames``); their size is said if it is one for all.

    A polygon with holes is written as several without: the format knows none, and readers unite them again.
    Raises GtlayoutError when the file cannot be written.
    """
    sizes = list({(frames[k.frame].camera.width, frames[k.frame].camera.height) for k in key_frames})
    entries = [_entry(frames[key_frame.frame].name, key_frame) for key_frame in key_frames]
    write_json_atomic(path, {"format": FORMAT, "image_size": sizes[0] if len(sizes) == 1 else None, "frames": entries})


def write_drafts(path: Path, frames: Sequence[Frame], drafts: Sequence[Draft]) -> None:
    """Put drafts into an annotation file that is there; those of the same images go, everything else stays.

    They are drawn on the images as the file has them: with their lens, turned by their tag, in its ``image_size``.
    Raises GtlayoutError when the file is no such file, or cannot be written.
    """
    data = read_json(path)
    if data.get("format") != FORMAT:
        raise GtlayoutError(f"{path}: format is {data.get('format')!r}, expected {FORMAT!r}")
    size = _image_size(data.get("image_size"), path)
    there = data.get(DRAFTS, [])
    if not isinstance(there, list):
        raise GtlayoutError(f"{path}: {DRAFTS} must be a list; mend it, or remove it")
    new = [_draft_entry(draft, frames[draft.key_frame.frame], size) for draft in drafts]
    images = {entry["image"] for entry in new}
    kept = [entry for entry in there if not (isinstance(entry, dict) and entry.get("image") in images)]
    write_json_atomic(path, {**data, DRAFTS: [*kept, *new]})


def write_draft_file(path: Path, frames: Sequence[Frame], drafts: Sequence[Draft]) -> None:
    """Write drafts alone, ``gtlayout-drafts/1``: for scenes whose drawings another tool's file holds.

    Each is in pixels of its image as it is shown. Raises GtlayoutError when the file cannot be written.
    """
    entries = [_draft_entry(draft, frames[draft.key_frame.frame], None) for draft in drafts]
    write_json_atomic(path, {"format": DRAFT_FORMAT, DRAFTS: entries})


def _draft_entry(draft: Draft, frame: Frame, size: tuple[int, int] | None) -> dict[str, Any]:
    """Raises GtlayoutError when the image cannot have the size that the file is drawn in."""
    view = View.of(frame.name, frame, size)
    if view.has_other_shape:
        raise GtlayoutError(
            f"{frame.name} has not the shape of the file's image_size {size}: no draft of it can stand there"
        )
    return _entry(frame.name, as_drawn(draft.key_frame, view), draft.scores)


def _entry(image: str, key_frame: KeyFrame, scores: Mapping[str, float] | None = None) -> dict[str, Any]:
    return {
        "image": image,
        "elements": [
            {
                "id": element.id,
                "label": element.label,
                **({} if scores is None else {"score": scores[element.id]}),
                "polygons": simple_rings(element.amodal),
                "visible": simple_rings(element.visible),
                **({CURVED: True} if element.curved else {}),
            }
            for element in key_frame.elements
        ],
        "occlusion_edges": list(key_frame.occlusion_edges),
        # Few have any, and readers before this key existed would say nothing of it.
        **({} if key_frame.blank.is_empty else {"blank": simple_rings(key_frame.blank)}),
    }


def _key_frame(data: Any, index: int, size: tuple[int, int] | None, notes: Notes) -> RawKeyFrame | None:
    if not isinstance(data, dict) or not isinstance(data.get("image"), str) or not data["image"]:
        notes.add("frame skipped: it has no image name", f"frame number {index}")
        return None
    image = printable(data["image"])
    elements: dict[str, RawShape] = {}
    for number, each in enumerate(_list(data, "elements", image, notes)):
        try:
            element = _element(each, image, notes)
        except UnusableError as reason:
            notes.add(f"element skipped: {reason}", f"{image}, element number {number}")
            continue
        if element.id in elements:
            notes.add("element skipped: another of its frame has its id", f"{image}, element {element.id}")
            continue
        elements[str(element.id)] = element
    edges = RawShape("occlusion_edge", lines=_polylines(data, "occlusion_edges", image, notes))
    blank = RawShape("blank", _polylines(data, "blank", image, notes))
    return RawKeyFrame(image, (*elements.values(), edges, *([blank] if blank.polygons else [])), size)


def _element(data: Any, image: str, notes: Notes) -> RawShape:
    own_id = name(data.get("id")) if isinstance(data, dict) else None
    label = name(data.get("label")) if isinstance(data, dict) else None
    if own_id is None or label is None:
        raise UnusableError(f"it has no {'id' if own_id is None else 'label'}")
    where = f"{image}, element {own_id}"
    polygons, curved = _polylines(data, "polygons", where, notes), is_curved(data.get(CURVED), notes, where)
    if not polygons:
        raise UnusableError("it has no polygon")
    return RawShape(label, polygons, visible=_polylines(data, "visible", where, notes), id=own_id, curved=curved)


def _polylines(data: dict[str, Any], key: str, where: str, notes: Notes) -> tuple[FloatArray, ...]:
    found = []
    for i, line in enumerate(_list(data, key, where, notes)):
        try:
            found.append(pairs(line))
        except UnusableError as reason:
            notes.add(f"line in {key} skipped: {reason}", f"{where}: {key}[{i}]")
    return tuple(found)


def _list(data: dict[str, Any], key: str, where: str, notes: Notes) -> list[Any]:
    value = data.get(key, [])
    if not isinstance(value, list):
        notes.add(f"{key} skipped: it is no list", where)
        return []
    return value


def _image_size(value: Any, path: Path) -> tuple[int, int] | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2 or not all(type(v) is int and 0 < v <= MAX_PX for v in value):
        raise GtlayoutError(f"{path}: image_size must be [width, height] in pixels, not {value!r}")
    return value[0], value[1]


READER = Reader("native", NATIVE_FILE, files_of_kind("native"), read_annotations)
