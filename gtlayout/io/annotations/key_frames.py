"""From annotations as drawn to key frames: labels are interpreted, images are found, elements are put together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.checked import because
from gtlayout.io.annotations.elements import DrawnElement, DrawnVisible, assemble
from gtlayout.io.annotations.frame_names import FrameFinder
from gtlayout.io.annotations.labels import FILE_NAME as LABELS_FILE
from gtlayout.io.annotations.labels import Kind, label_meanings, meaning
from gtlayout.io.annotations.outlines import MAX_STRETCH, Repairs, View, polyline, region, united
from gtlayout.io.sources import RawAnnotations, RawKeyFrame
from gtlayout.limits import ELEMENTS
from gtlayout.scene import LABELS, FloatArray, Frame, KeyFrame


def build_key_frames(
    annotations: RawAnnotations, frames: Sequence[Frame], without_image: Sequence[str], own_labels: Mapping[str, Kind]
) -> tuple[tuple[KeyFrame, ...], list[str]]:
    """Key frames in video order, and one warning per thing repaired or left out.

    Left out are polygons with fewer than 3 points, without area or off the image, elements with nothing left or with an
    unknown label, images without elements, without camera or image file (``without_image`` names cameras without), of
    another shape than their frame, or annotated a second time. Self-crossing polygons are repaired; all is clipped to
    the image. Raises GtlayoutError when nothing is left.
    """
    meanings = label_meanings(own_labels)
    find = FrameFinder(annotations, frames, without_image)
    repairs, unknown_labels = Repairs(), Counter[str]()
    by_frame: dict[int, KeyFrame] = {}
    skipped, resized, shown_turned = [], [], []
    for raw in annotations.key_frames:
        match = find(raw)
        if isinstance(match, str):
            skipped.append(f"annotated image {raw.image} {match}")
            continue
        index = match.index
        if index in by_frame:
            skipped.append(f"image {raw.image} is annotated twice, the first time counts")
            continue
        if why := ELEMENTS.exceeded(len(raw.shapes)):
            skipped.append(f"{raw.image} skipped: {why}")
            continue
        view = View.of(raw.image, frames[index], raw.image_size, on_video=match.on_video)
        if problem := _other_shape(view):
            skipped.append(problem)
            continue
        if view.annotated_size != view.drawn_size:
            resized.append(view)
        # Whatever shows a video turns it, CVAT, too.
        if view.drawn_on_shown and not match.on_video and (raw.image_size is None or view.sizes_cannot_tell):
            shown_turned.append(view)
        by_frame[index] = _key_frame(raw, index, view, meanings, repairs, unknown_labels)
    file = annotations.path.name
    warnings = [
        *(
            f"{file}: {n} shapes with unknown label {label!r} dropped (known: {', '.join(LABELS)}, visible, "
            f"occlusion_edge, blank; {LABELS_FILE} can say what others mean)"
            for label, n in sorted(unknown_labels.items())
        ),
        *(f"{file}: {line}" for line in (*find.warnings, *skipped)),
        *([_resized(file, resized)] if resized else []),
        *([_shown_turned(file, shown_turned)] if shown_turned else []),
        *(
            [f"{file}: {repairs.overhanging} polygons reach beyond the image and were clipped"]
            if repairs.overhanging
            else []
        ),
        *repairs.lines,
    ]
    key_frames = tuple(by_frame[index] for index in sorted(by_frame) if by_frame[index].elements)
    if not key_frames:
        reasons = [*_in_shares(annotations.key_frames), *annotations.warnings, *annotations.notes, *warnings]
        why = because(reasons or ["nothing is drawn in it"], file)
        raise GtlayoutError(f"{annotations.path}: no usable element in any frame{why}")
    if all(element.visible.is_empty for key_frame in key_frames for element in key_frame.elements):
        warnings.append("no visible parts drawn: points are tracked on whole elements, furniture before them too")
    return key_frames, warnings


def _in_shares(key_frames: Sequence[RawKeyFrame]) -> list[str]:
    """A line where all that is drawn lies within one pixel."""
    rings = [ring for raw in key_frames for shape in raw.shapes for ring in shape.polygons if len(ring)]
    if not rings or np.abs(np.concatenate(rings)).max() > 1:
        return []
    return ["all its coordinates lie between 0 and 1, as if they were shares of the image: they must be px"]


def _key_frame(
    raw: RawKeyFrame,
    index: int,
    view: View,
    meanings: Mapping[str, Kind],
    repairs: Repairs,
    unknown_labels: Counter[str],
) -> KeyFrame:
    elements: list[DrawnElement] = []
    visible: list[DrawnVisible] = []
    edges: list[FloatArray] = []
    blank: list[MultiPolygon] = []
    for number, shape in enumerate(raw.shapes, start=1):
        kind = meaning(shape.label, meanings)
        where = f"{view.name}, " + (f"element {shape.id}" if shape.id else f"shape {number} ({shape.label})")
        if kind is None:
            unknown_labels[shape.label] += 1
        elif kind == "occlusion_edge":
            edges += [piece for line in shape.lines for piece in polyline(line, view, repairs)]
            if shape.polygons:
                repairs.lines.append(f"{where}: an occlusion edge is a polyline, the polygon was dropped")
        elif kind != "ignored" and not shape.polygons and shape.lines:
            repairs.lines.append(f"{where}: a polyline encloses no area, dropped")
        elif kind == "blank":
            blank.append(region(shape.polygons, view, where, repairs))
        elif kind == "visible":
            part = region(shape.polygons, view, f"{where}, visible part", repairs)
            if not part.is_empty:
                visible.append(DrawnVisible(part, shape.element, shape.group))
        elif kind != "ignored":
            amodal = region(shape.polygons, view, where, repairs)
            if amodal.is_empty:
                repairs.lines.append(f"{where}: no polygon left within the image, element dropped")
                continue
            seen = region(shape.visible, view, f"{where}, visible part", repairs)
            curved = shape.curved and kind == "wall"
            if shape.curved and not curved:
                repairs.lines.append(f"{where}: only a wall can be curved, this {kind} is read as flat")
            elements.append(DrawnElement(kind, amodal, seen, shape.id, shape.group, shape.z_order, curved))
    assembled, notes = assemble(elements, visible)
    repairs.lines += [f"{view.name}: {note}" for note in notes]
    if not assembled:
        repairs.lines.append(f"{view.name}: no element annotated, not used as a key frame")
    return KeyFrame(index, assembled, tuple(edges), united(blank))


def _other_shape(view: View) -> str | None:
    if not view.has_other_shape:
        return None
    (width, height), (drawn_width, drawn_height) = view.annotated_size, view.drawn_size
    turned = abs(height * drawn_height / (width * drawn_width) - 1) <= MAX_STRETCH
    hint = "it was shown turned: remove the EXIF orientation" if turned else "annotate the images as they are"
    return f"{view.name} was annotated at {width}x{height} px but its camera says {drawn_width}x{drawn_height}: {hint}"


def _resized(file: str, views: Sequence[View]) -> str:
    (width, height), (file_width, file_height) = views[0].annotated_size, views[0].drawn_size
    return (
        f"{file}: {len(views)} images were annotated in another size, first {views[0].name} at {width}x{height} px "
        f"instead of {file_width}x{file_height}: their shapes were scaled"
    )


def _shown_turned(file: str, views: Sequence[View]) -> str:
    return (
        f"{file}: {len(views)} annotated images have an orientation tag (EXIF), first {views[0].name}: they were read "
        "as drawn on the image as tools show it, turned; if the tool showed the pixels as stored, remove the tag"
    )
