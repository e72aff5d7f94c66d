"""COCO instances, and what the amodal data sets KINS, COCOA and D2SA made of them.

Facts are from COCO's "Data format" page ("coordinates are measured from the top left image corner and are 0-indexed"),
its mask API, which fills the polygon 10,20 … 30,40 with the pixels 10 to 29 and 20 to 39, Datumaro's exporter
(``attributes``, masks with ``iscrowd`` 1, size 0 for an unknown one), and the APIs of the amodal data sets:

* KINS: ``segmentation`` or ``a_segm`` is amodal, ``inmodal_seg`` or ``i_segm`` what is seen of it;
* D2SA: ``segmentation`` is amodal, ``visible_mask`` what is seen of it;
* COCOA: an annotation is an image with ``regions``, each with a ``name``; one nothing hides has no ``visible_mask``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import shapely
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import files_of_kind
from gtlayout.io.annotations.checked import (
    CURVED,
    NO_OCCLUSION_EDGES,
    Notes,
    UnusableError,
    because,
    image_size,
    is_curved,
    name,
    points,
)
from gtlayout.io.annotations.coco.rle import rle_rings
from gtlayout.io.annotations.masks import simple_rings
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.io.sources import RawAnnotations, RawKeyFrame, RawShape, Reader
from gtlayout.scene import LABELS, FloatArray, Frame, KeyFrame

AMODAL_FIELDS = ("segmentation", "a_segm")
VISIBLE_FIELDS = ("inmodal_seg", "i_segm", "visible_mask")
VISIBLE = "visible"
BLANK = "blank"
CATEGORIES = (*LABELS, VISIBLE, BLANK)


@dataclass(frozen=True)
class _Image:
    name: str
    size: tuple[int, int] | None
    shapes: list[RawShape] = field(default_factory=list)


def read_coco(_root: Path, path: Path) -> RawAnnotations:
    """Read the file; images without an annotation are no key frames.

    ``attributes`` may hold an ``id``, ``curved``, and, of a category that means visible parts, the ``element`` they
    belong to. Annotations without segmentation (boxes, key points, captions), of images or categories that the file
    does not have, or with broken outlines or masks are dropped with a warning per kind. Raises GtlayoutError when the
    file is no such JSON or nothing in it can be used.
    """
    data = read_json(path)
    notes = Notes()
    images = _images(_list(data, "images", path), notes)
    categories = {
        key: label
        for each in _list(data, "categories", path, required=False)
        if isinstance(each, dict) and (key := _key(each.get("id"))) is not None and (label := name(each.get("name")))
    }
    for annotation in _list(data, "annotations", path):
        if isinstance(annotation, dict):
            _add(annotation, images.get(_key(annotation.get("image_id"))), categories, notes)
        else:
            notes.add("annotation skipped: it is no object", "annotations")
    key_frames = tuple(
        RawKeyFrame(image.name, tuple(image.shapes), image.size) for image in images.values() if image.shapes
    )
    warnings = notes.lines(path.name)
    if not key_frames:
        raise GtlayoutError(f"{path}: no annotation can be used{because(warnings or ['it has none'], path.name)}")
    listed = tuple(image.name for image in images.values())
    return RawAnnotations(path, key_frames, (f"{path}: COCO has {NO_OCCLUSION_EDGES}", *warnings), listed=listed)


def write_coco(path: Path, frames: Sequence[Frame], key_frames: Sequence[KeyFrame]) -> None:
    """Write ``key_frames`` (indices into ``frames``), visible parts as annotations of a category of their own.

    Polygons with holes are cut into some without, which keeps them exact: as run lengths they would be whole pixels.
    The format has no place for occlusion edges: they are not written. Raises GtlayoutError when the file cannot be.
    """
    images, annotations = [], []
    for image_id, key_frame in enumerate(key_frames, start=1):
        frame = frames[key_frame.frame]
        size = {"width": frame.camera.width, "height": frame.camera.height}
        images.append({"id": image_id, "file_name": frame.name, **size})
        for element in key_frame.elements:
            said: dict[str, str | bool] = {"id": element.id, **({CURVED: True} if element.curved else {})}
            annotations.append(_annotation(element.amodal, element.label, image_id, said))
            if not element.visible.is_empty:
                annotations.append(_annotation(element.visible, VISIBLE, image_id, {"element": element.id}))
        if not key_frame.blank.is_empty:
            annotations.append(_annotation(key_frame.blank, BLANK, image_id, {}))
    categories = [{"id": i, "name": label, "supercategory": ""} for i, label in enumerate(CATEGORIES, start=1)]
    numbered = [{"id": i, **annotation} for i, annotation in enumerate(annotations, start=1)]
    parts = {"info": {}, "licenses": [], "categories": categories, "images": images, "annotations": numbered}
    write_json_atomic(path, parts)


def _images(entries: list[Any], notes: Notes) -> dict[Any, _Image]:
    images: dict[Any, _Image] = {}
    for entry in entries:
        key = _key(entry.get("id")) if isinstance(entry, dict) else None
        file_name = name(entry.get("file_name")) if key is not None else None
        if file_name is None:
            notes.add("image skipped: it has no id or no file_name", "images")
        elif key in images:
            notes.add("image skipped: another has its id", file_name)
        else:
            images[key] = _Image(file_name, image_size(entry.get("width"), entry.get("height")))
    return images


def _add(annotation: dict[str, Any], image: _Image | None, categories: Mapping[Any, str], notes: Notes) -> None:
    where = f"annotation {name(annotation.get('id'))}"
    if image is None:
        notes.add("annotation skipped: its image is none of the file's", where)
        return
    regions = annotation.get("regions")
    parts = regions if isinstance(regions, list) else [annotation]
    for part in parts:
        try:
            image.shapes.append(_shape(part, annotation, image, categories, notes))
        except UnusableError as reason:
            notes.add(f"annotation skipped: {reason}", f"{image.name}, {where}")


def _shape(
    part: Any, annotation: dict[str, Any], image: _Image, categories: Mapping[Any, str], notes: Notes
) -> RawShape:
    """``part`` is the annotation itself or, in COCOA, one of its regions."""
    if not isinstance(part, dict):
        raise UnusableError("its region is none")
    is_region = part is not annotation
    label = name(part.get("name")) if is_region else categories.get(_key(part.get("category_id")))
    if label is None:
        raise UnusableError("its category is none of the file's")
    polygons = _rings(_first(part, AMODAL_FIELDS), image.size)
    if not polygons:
        raise UnusableError("it has no segmentation")
    seen = _first(part, VISIBLE_FIELDS)
    visible = polygons if is_region and seen is None and not part.get("invisible_mask") else _rings(seen, image.size)
    given = part.get("attributes")
    attributes = {key.casefold(): value for key, value in given.items()} if isinstance(given, dict) else {}
    return RawShape(
        label,
        polygons,
        visible=visible,
        id=name(attributes.get("id")),
        element=name(attributes.get("element")),
        curved=is_curved(attributes.get(CURVED), notes, image.name),
    )


def _rings(segmentation: Any, size: tuple[int, int] | None) -> tuple[FloatArray, ...]:
    """Run lengths, a list of polygons or, in COCOA, one polygon → rings; raises UnusableError."""
    if isinstance(segmentation, dict):
        return rle_rings(segmentation, size)
    if not segmentation:
        return ()
    if not isinstance(segmentation, list):
        raise UnusableError("its segmentation is neither polygons nor a mask")
    if isinstance(segmentation[0], list):
        return tuple(points(polygon) for polygon in segmentation)
    return (points(segmentation),)


def _first(part: dict[str, Any], fields: tuple[str, ...]) -> Any:
    return next((part[field] for field in fields if part.get(field) is not None), None)


def _key(value: Any) -> int | float | str | None:
    """An id that can be looked up."""
    return value if isinstance(value, int | float | str) else None


def _list(data: dict[str, Any], key: str, path: Path, *, required: bool = True) -> list[Any]:
    value = data.get(key, None if required else [])
    if not isinstance(value, list):
        raise GtlayoutError(f"{path}: {key} must be a list" + ("" if key in data else ", it is missing"))
    return value


def _annotation(
    region: MultiPolygon, label: str, image_id: int, attributes: Mapping[str, str | bool]
) -> dict[str, Any]:
    x_min, y_min, x_max, y_max = shapely.bounds(region).tolist()
    return {
        "image_id": image_id,
        "category_id": CATEGORIES.index(label) + 1,
        "segmentation": [ring.ravel() for ring in simple_rings(region)],
        "area": region.area,
        "bbox": [x_min, y_min, x_max - x_min, y_max - y_min],
        "iscrowd": 0,
        "attributes": attributes,
    }


READER = Reader("COCO", "COCO's instances .json", files_of_kind("coco"), read_coco)
