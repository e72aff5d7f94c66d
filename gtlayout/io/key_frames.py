"""From annotations as drawn to key frames: matched to frames, undistorted, repaired, clipped to the image."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.errors import GtlayoutError
from gtlayout.io.sources import RawAnnotations, RawElement, RawKeyFrame
from gtlayout.io.undistort import Undistortion
from gtlayout.scene import LABELS, Element, FloatArray, Frame, KeyFrame

OVERHANG_PX = 1.0
"""A vertex up to this far off the image is rounding, and clipped without a word."""
MIN_AREA_PX2 = 1.0
"""Pieces smaller than a pixel are left-overs of repair and clipping."""


def build_key_frames(
    annotations: RawAnnotations, frames: Sequence[Frame], without_image: Sequence[str]
) -> tuple[tuple[KeyFrame, ...], list[str]]:
    """Key frames in video order, and one warning per thing repaired or left out.

    Polygons with fewer than 3 points, without area or off the image, elements with nothing left or with an unknown
    label, and frames without elements are left out; self-crossing polygons are repaired; all is clipped to the image.
    ``without_image`` names cameras whose image file is missing. Raises GtlayoutError when an annotated image has no
    camera or no image file, is annotated twice or at another size, or nothing is annotated at all.
    """
    report = _Report()
    by_frame: dict[int, KeyFrame] = {}
    for raw in annotations.key_frames:
        index = _find_frame(raw.image, frames, without_image, annotations)
        if index in by_frame:
            raise GtlayoutError(f"{annotations.path}: image {raw.image} is annotated twice")
        frame = frames[index]
        lens = frame.undistort if isinstance(frame.undistort, Undistortion) else None
        view = _View(raw.image, lens, frame.camera.width, frame.camera.height)
        _check_size(raw, view, annotations)
        elements = tuple(e for e in (_element(each, view, report) for each in raw.elements) if e is not None)
        edges = tuple(piece for line in raw.occlusion_edges for piece in _polyline(line, view, report))
        if not elements:
            report.lines.append(f"{raw.image}: no element annotated, not used as a key frame")
        by_frame[index] = KeyFrame(index, elements, edges)
    if all(element.visible.is_empty for key_frame in by_frame.values() for element in key_frame.elements):
        report.lines.append("no visible parts drawn: points are tracked on whole elements, furniture before them too")
    warnings = report.all(annotations.path.name)
    key_frames = tuple(by_frame[index] for index in sorted(by_frame) if by_frame[index].elements)
    if not key_frames:
        why = f" ({warnings[0]})" if warnings else ""
        raise GtlayoutError(f"{annotations.path}: no usable element in any frame{why}")
    return key_frames, warnings


@dataclass
class _Report:
    lines: list[str] = field(default_factory=list)
    unknown_labels: Counter[str] = field(default_factory=Counter)
    overhanging: int = 0

    def all(self, file: str) -> list[str]:
        known = ", ".join(LABELS)
        return [
            *(
                f"{file}: {n} elements with unknown label {label!r} dropped (known: {known})"
                for label, n in sorted(self.unknown_labels.items())
            ),
            *(
                [f"{file}: {self.overhanging} polygons reach beyond the image and were clipped"]
                if self.overhanging
                else []
            ),
            *self.lines,
        ]


@dataclass(frozen=True)
class _View:
    """The image an annotator saw, and the way from its pixels to the pinhole camera's."""

    name: str
    lens: Undistortion | None
    pinhole_width: int
    pinhole_height: int

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) px of the image file."""
        return (self.lens.width, self.lens.height) if self.lens else (self.pinhole_width, self.pinhole_height)

    def to_pinhole(self, points_px: FloatArray) -> FloatArray:
        return self.lens.points(points_px) if self.lens else points_px


def _find_frame(image: str, frames: Sequence[Frame], without_image: Sequence[str], annotations: RawAnnotations) -> int:
    """The frame that is called so in full, from the scene folder, or else by its bare file name."""
    wanted = PurePosixPath(image.replace("\\", "/"))
    full = [i for i, f in enumerate(frames) if str(wanted) in (f.name, f"images/{f.name}")]
    found = full or [i for i, f in enumerate(frames) if PurePosixPath(f.name).name == wanted.name]
    if len(found) == 1:
        return found[0]
    if found:
        names = f"{frames[found[0]].name} and {frames[found[1]].name}"
        raise GtlayoutError(f"{annotations.path}: image {image} may be {names}; write its folder, too")
    what = "image file" if any(PurePosixPath(name).name == wanted.name for name in without_image) else "camera"
    raise GtlayoutError(f"{annotations.path}: annotated image {image} has no {what}")


def _check_size(raw: RawKeyFrame, view: _View, annotations: RawAnnotations) -> None:
    if raw.image_size is not None and raw.image_size != view.size:
        annotated, camera = (f"{width}x{height}" for width, height in (raw.image_size, view.size))
        raise GtlayoutError(
            f"{annotations.path}: image_size is {annotated} but the camera of {raw.image} says {camera}: "
            "annotate the images as they are"
        )


def _element(raw: RawElement, view: _View, report: _Report) -> Element | None:
    label = next((known for known in LABELS if known == raw.label), None)
    if label is None:
        report.unknown_labels[raw.label] += 1
        return None
    where = f"{view.name}, element {raw.id}"
    amodal = _region(raw.polygons, view, where, report)
    if amodal.is_empty:
        report.lines.append(f"{where}: no polygon left within the image, element dropped")
        return None
    return Element(raw.id, label, amodal, _region(raw.visible, view, f"{where}, visible part", report))


def _region(polygons: Sequence[FloatArray], view: _View, where: str, report: _Report) -> MultiPolygon:
    """The union of the polygons, in the pinhole image."""
    pieces = [_polygon(points_px, view, where, report) for points_px in polygons]
    return _polygonal(shapely.union_all([piece for piece in pieces if not piece.is_empty]))


def _polygon(points_px: FloatArray, view: _View, where: str, report: _Report) -> MultiPolygon:
    if len(np.unique(points_px, axis=0)) < 3:
        report.lines.append(f"{where}: polygon with fewer than 3 points dropped")
        return MultiPolygon()
    polygon: BaseGeometry = Polygon(points_px)
    if not polygon.is_valid:
        polygon = _polygonal(_valid(polygon))
        what = "polygon without area dropped" if polygon.is_empty else "self-crossing polygon repaired"
        report.lines.append(f"{where}: {what}")
    if polygon.is_empty:
        return MultiPolygon()
    image = shapely.box(0, 0, *view.size)
    # Clipped before undistortion: off the image a lens model means nothing.
    inside = _polygonal(polygon if image.covers(polygon) else polygon & image)
    if inside.is_empty:
        report.lines.append(f"{where}: polygon off the image dropped")
        return inside
    report.overhanging += not image.buffer(OVERHANG_PX, join_style="mitre").covers(polygon)
    if view.lens is None:
        return inside
    # Vertices only: what is straight in the room is straight between undistorted vertices.
    straight = shapely.transform(inside, view.to_pinhole)
    if not np.all(np.isfinite(shapely.get_coordinates(straight))):
        report.lines.append(f"{where}: polygon dropped, the lens model has no inverse at one of its points")
        return MultiPolygon()
    return _polygonal(_valid(straight) & shapely.box(0, 0, view.pinhole_width, view.pinhole_height))


def _polyline(points_px: FloatArray, view: _View, report: _Report) -> list[FloatArray]:
    """The parts of a polyline within the image, in the pinhole image."""
    if len(np.unique(points_px, axis=0)) < 2:
        report.lines.append(f"{view.name}: occlusion edge with fewer than 2 points dropped")
        return []
    image = shapely.box(0, 0, *view.size)
    line: BaseGeometry = LineString(points_px)
    if not image.covers(line):
        line = shapely.line_merge(line & image)
    pieces = [
        view.to_pinhole(np.array(part.coords)) for part in shapely.get_parts(line) if isinstance(part, LineString)
    ]
    return [piece for piece in pieces if np.all(np.isfinite(piece))]


def _valid(geometry: BaseGeometry) -> BaseGeometry:
    """``structure`` keeps what a polygon covers twice; the default method would make a hole of it."""
    return shapely.make_valid(geometry, method="structure", keep_collapsed=False)


def _polygonal(geometry: BaseGeometry) -> MultiPolygon:
    """The polygons in a geometry, without those smaller than a pixel."""
    parts = shapely.get_parts(shapely.get_parts(geometry))
    return MultiPolygon([part for part in parts if isinstance(part, Polygon) and part.area >= MIN_AREA_PX2])
