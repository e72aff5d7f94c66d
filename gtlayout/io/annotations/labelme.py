"""LabelMe: a folder with one JSON file per image, often the folder of the images.

Facts are from LabelMe's own example files and code. It draws image and shapes in one Qt painter, whose coordinates have
(0, 0) at the corner of the first pixel (Qt's documentation, "Coordinate System"); up to version 5 a point goes no
farther than width - 1 and height - 1, which is within what counts as the image's border here. A mask is a base64 PNG
that covers the pixels from the first to the second of its two points, both included (``shapes_to_label``); other
writers' second point is the first pixel beyond, so the PNG's own size counts.
``imageData``, a copy of the image, is not looked at.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import files_of_kind
from gtlayout.io.annotations.checked import CURVED, Notes, UnusableError, image_size, is_curved, name, pairs
from gtlayout.io.annotations.masks import decode_mask, mask_polygons, simple_rings
from gtlayout.io.archives import archive_of
from gtlayout.io.files import json_text, read_json, write_all_atomic
from gtlayout.io.sources import RawAnnotations, RawKeyFrame, RawShape, Reader
from gtlayout.scene import FloatArray, Frame, KeyFrame

POLYGONS = ("polygon", "rectangle", "rotation", "oriented_rectangle", "quadrilateral")
"""The last three are X-AnyLabeling's."""
LINES = ("line", "linestrip")
VERSION = "5.0.1"
"""The format as written here is understood by all since."""
ID = re.compile(r"id=(.+)")
"""A description that names an element; LabelMe itself knows groups only."""


def read_labelme(_root: Path, folder: Path) -> RawAnnotations:
    """Read the files in a folder or a zip, or a single one; those without a shape are no key frames.

    Shapes of a group and a label are parts of one element, ``visible`` ones of a group its visible parts. Circles,
    points, broken shapes, and files that cannot be read are dropped with a warning per kind. Raises GtlayoutError when
    no file can be read.
    """
    key_frames: list[RawKeyFrame] = []
    notes, broken = Notes(), []
    files = files_of_kind("labelme")(folder)
    for path in files:
        try:
            key_frame = _key_frame(path, notes)
        except GtlayoutError as error:
            broken.append(str(error))
            continue
        if key_frame.shapes:
            key_frames.append(key_frame)
    if len(broken) == len(files):
        raise GtlayoutError(broken[0] if broken else f"{folder} holds no file of LabelMe's")
    skipped = [f"{line}, skipped" for line in broken]
    return RawAnnotations(folder, tuple(key_frames), (*skipped, *notes.lines(folder.name)))


def write_labelme(folder: Path, frames: Sequence[Frame], key_frames: Sequence[KeyFrame]) -> None:
    """Write one file per key frame (indices into ``frames``), all or none; to open them, put the images beside them.

    Polygons with holes are cut into some without. Raises GtlayoutError when two images would share a file, or the disk
    does not take them.
    """
    contents: dict[Path, bytes | str] = {}
    for key_frame in key_frames:
        frame = frames[key_frame.frame]
        path = folder / f"{PurePosixPath(frame.name).stem}.json"
        if path in contents:
            raise GtlayoutError(f"cannot write {path}: two images of that name, LabelMe keeps all in one folder")
        contents[path] = json_text(
            {
                "version": VERSION,
                "flags": {},
                "shapes": _shapes(key_frame),
                "imagePath": frame.name,
                "imageData": None,
                "imageHeight": frame.camera.height,
                "imageWidth": frame.camera.width,
            }
        )
    write_all_atomic(contents)


def _key_frame(path: Path, notes: Notes) -> RawKeyFrame:
    data = read_json(path)
    shapes = data.get("shapes")
    if not isinstance(shapes, list):
        raise GtlayoutError(f"{path}: shapes must be a list" + ("" if "shapes" in data else ", it is missing"))
    # Relative to the file; it is looked for among the frames, never opened.
    image = name(data.get("imagePath")) or path.stem
    found = []
    for shape in shapes:
        try:
            found.append(_shape(shape, path.name, notes))
        except UnusableError as reason:
            kind = (name(shape.get("shape_type")) if isinstance(shape, dict) else None) or "shape"
            notes.add(f"{kind} skipped: {reason}", path.name)
    return RawKeyFrame(image, tuple(found), image_size(data.get("imageWidth"), data.get("imageHeight")))


def _shape(shape: Any, where: str, notes: Notes) -> RawShape:
    label = name(shape.get("label")) if isinstance(shape, dict) else None
    if label is None:
        raise UnusableError("it has no label")
    kind = shape.get("shape_type") or "polygon"  # version 3 said nothing, or null
    points_px = pairs(shape.get("points"))
    polygons: tuple[FloatArray, ...] = ()
    lines: tuple[FloatArray, ...] = ()
    if kind == "mask":
        polygons = _mask(shape.get("mask"), points_px)
    elif kind == "rectangle" and len(points_px) == 2:
        (x0, y0), (x1, y1) = points_px
        polygons = (np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]),)
    elif kind in POLYGONS:
        polygons = (points_px,)
    elif kind in LINES:
        lines = (points_px,)
    else:
        raise UnusableError("it is no polygon, rectangle, mask, line or linestrip")
    flags = shape.get("flags")
    description = ID.fullmatch(name(shape.get("description")) or "")
    return RawShape(
        label,
        polygons,
        lines,
        id=description[1] if description else None,
        group=name(shape.get("group_id")),
        curved=isinstance(flags, dict) and is_curved(flags.get(CURVED), notes, where),
    )


def _mask(png_base64: Any, points_px: FloatArray) -> tuple[FloatArray, ...]:
    if not isinstance(png_base64, str) or len(points_px) != 2:
        raise UnusableError("its mask lacks its two points or its pixels")
    try:
        png = base64.b64decode(png_base64)
    except ValueError as error:
        raise UnusableError("its mask is no base64") from error
    try:
        mask = decode_mask(png)
        regions = mask_polygons(mask > 0)
    except ValueError as error:
        raise UnusableError(f"its mask {error}") from error
    beyond = mask.shape[::-1] - (points_px[1] - points_px[0])
    if not np.all((beyond > -0.5) & (beyond < 1.5)):
        raise UnusableError("its mask has another size than its two points say")
    return tuple(ring + points_px[0] for ring in simple_rings(regions))


def _shapes(key_frame: KeyFrame) -> list[dict[str, Any]]:
    shapes = [_written("occlusion_edge", "linestrip", line) for line in key_frame.occlusion_edges]
    shapes += [_written("blank", "polygon", ring) for ring in simple_rings(key_frame.blank)]
    for group, element in enumerate(key_frame.elements, start=1):
        regions: tuple[tuple[str, MultiPolygon, str, dict[str, bool]], ...] = (
            (element.label, element.amodal, f"id={element.id}", {CURVED: True} if element.curved else {}),
            ("visible", element.visible, "", {}),
        )
        shapes += [
            _written(label, "polygon", ring, group, description, flags)
            for label, region, description, flags in regions
            for ring in simple_rings(region)
        ]
    return shapes


def _written(
    label: str,
    shape_type: str,
    points_px: FloatArray,
    group: int | None = None,
    description: str = "",
    flags: dict[str, bool] | None = None,
) -> dict[str, Any]:
    return {
        "label": label,
        "points": points_px,
        "group_id": group,
        "description": description,
        "shape_type": shape_type,
        "flags": flags or {},
    }


def _detect(place: Path) -> list[Path]:
    """Folders; a zip counts as one, and a file that is named as itself."""
    files = files_of_kind("labelme")(place)
    return files if files == [place] else list(dict.fromkeys(archive_of(path) or path.parent for path in files))


READER = Reader("LabelMe", "LabelMe's .json files", _detect, read_labelme)
