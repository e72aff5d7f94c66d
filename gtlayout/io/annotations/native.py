"""The native annotation file ``annotations.json``, format ``gtlayout-annotations/1``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import NATIVE_FILE, files_of_kind
from gtlayout.io.annotations.checked import MAX_PX, is_px
from gtlayout.io.annotations.masks import simple_rings
from gtlayout.io.files import printable, read_json, write_json_atomic
from gtlayout.io.sources import RawAnnotations, RawKeyFrame, RawShape, Reader
from gtlayout.scene import FloatArray, Frame, KeyFrame

FORMAT = "gtlayout-annotations/1"


def read_annotations(_root: Path, path: Path) -> RawAnnotations:
    """Read the file; geometry is left as drawn.

    Raises GtlayoutError naming file, frame and element for whatever has the wrong type or is not a finite number, and
    for ids that occur twice in a frame.
    """
    data = read_json(path)
    if data.get("format") != FORMAT:
        raise GtlayoutError(f"{path}: format is {data.get('format')!r}, expected {FORMAT!r}")
    size = _image_size(data.get("image_size"), path)
    frames = _list(data, "frames", f"{path}", required=True)
    return RawAnnotations(path, tuple(_key_frame(frame, i, size, path) for i, frame in enumerate(frames)))


def write_annotations(path: Path, frames: Sequence[Frame], key_frames: Sequence[KeyFrame]) -> None:
    """Write ``key_frames`` (indices into ``frames``); their size is said if it is one for all.

    A polygon with holes is written as several without: the format knows none, and readers unite them again.
    Raises GtlayoutError when the file cannot be written.
    """
    sizes = list({(frames[k.frame].camera.width, frames[k.frame].camera.height) for k in key_frames})
    entries = [
        {
            "image": frames[key_frame.frame].name,
            "elements": [
                {
                    "id": element.id,
                    "label": element.label,
                    "polygons": simple_rings(element.amodal),
                    "visible": simple_rings(element.visible),
                }
                for element in key_frame.elements
            ],
            "occlusion_edges": list(key_frame.occlusion_edges),
        }
        for key_frame in key_frames
    ]
    write_json_atomic(path, {"format": FORMAT, "image_size": sizes[0] if len(sizes) == 1 else None, "frames": entries})


def _key_frame(data: Any, index: int, size: tuple[int, int] | None, path: Path) -> RawKeyFrame:
    if not isinstance(data, dict) or not isinstance(data.get("image"), str) or not data["image"]:
        raise GtlayoutError(f"{path}: frame number {index} has no image name")
    image = printable(data["image"])
    where = f"{path}: frame {image}"
    elements = tuple(_element(e, i, where) for i, e in enumerate(_list(data, "elements", where, required=True)))
    ids = [str(element.id) for element in elements]
    twice = sorted({each for each in ids if ids.count(each) > 1})
    if twice:
        raise GtlayoutError(f"{where}: element id {twice[0]} occurs more than once; ids must be unique within a frame")
    edges = RawShape("occlusion_edge", lines=_polylines(data, "occlusion_edges", where))
    return RawKeyFrame(image, (*elements, edges), size)


def _element(data: Any, index: int, where: str) -> RawShape:
    if not isinstance(data, dict) or not isinstance(data.get("id"), str | int) or isinstance(data["id"], bool):
        raise GtlayoutError(f"{where}: element number {index} has no id")
    own_id = printable(str(data["id"]))
    where = f"{where}, element {own_id}"
    if not isinstance(data.get("label"), str):
        raise GtlayoutError(f"{where} has no label")
    polygons = _polylines(data, "polygons", where, required=True)
    visible = _polylines(data, "visible", where)
    return RawShape(printable(data["label"]), polygons, visible=visible, id=own_id)


def _polylines(data: dict[str, Any], key: str, where: str, *, required: bool = False) -> tuple[FloatArray, ...]:
    return tuple(
        _points(line, f"{where}: {key}[{i}]") for i, line in enumerate(_list(data, key, where, required=required))
    )


def _list(data: dict[str, Any], key: str, where: str, *, required: bool = False) -> list[Any]:
    value = data.get(key, None if required else [])
    if not isinstance(value, list):
        raise GtlayoutError(f"{where}: {key} must be a list" + ("" if key in data else ", it is missing"))
    return value


def _points(value: Any, where: str) -> FloatArray:
    """(N, 2) from a list of [x, y]."""
    if not isinstance(value, list) or not all(
        isinstance(p, list) and len(p) == 2 and all(map(is_px, p)) for p in value
    ):
        raise GtlayoutError(f"{where} must be a list of [x, y] in pixels, all of them finite numbers")
    return np.array(value, dtype=np.float64).reshape(-1, 2)


def _image_size(value: Any, path: Path) -> tuple[int, int] | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2 or not all(type(v) is int and 0 < v <= MAX_PX for v in value):
        raise GtlayoutError(f"{path}: image_size must be [width, height] in pixels, not {value!r}")
    return value[0], value[1]


READER = Reader("native", NATIVE_FILE, files_of_kind("native"), read_annotations)
