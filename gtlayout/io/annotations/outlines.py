"""Outlines as drawn → regions of the pinhole image: repaired, clipped to the image, undistorted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.io.annotations.coarser import MAX_CROSSING, few_crossings, few_points, few_vertices
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.cameras.upright import Upright
from gtlayout.io.pixels.turn import AS_STORED
from gtlayout.scene import FloatArray, Frame

OVERHANG_PX = 1.0
"""A vertex up to this far off the image is rounding, and clipped without a warning."""
MIN_AREA_PX2 = 1.0
"""Pieces smaller than a pixel are left-overs of repair and clipping."""
REDUNDANT_PX = 0.5
"""How far an outline may move when vertices go that say nothing: as far as rounding to whole pixels moves it, less than
a hand is off. Of an image of 640x480; see ``Camera.annotation_scale`` for others."""
MAX_STRETCH = 0.01
"""Annotated copies of the images may have another size, but not another shape."""
MOST_CLICKED = 64
"""Polygons with no more vertices were clicked one by one, and keep them; masks and brush strokes have one a pixel."""

NOTHING = MultiPolygon()


@dataclass
class Repairs:
    """What was repaired or left out, one line each."""

    lines: list[str] = field(default_factory=list)
    overhanging: int = 0


@dataclass(frozen=True)
class View:
    """The image an annotator saw, and the way from its pixels to the pinhole camera's."""

    name: str
    lens: Undistortion | Upright | None
    pinhole_size: tuple[int, int]
    """(width, height) px."""
    annotated_size: tuple[int, int]
    """(width, height) px of the copy of the image file that was drawn on."""
    annotation_scale: float
    """That of the pinhole camera."""

    @classmethod
    def of(cls, name: str, frame: Frame, annotated_size: tuple[int, int] | None, *, on_video: bool = False) -> View:
        """The frame as an annotator saw it; in the size of the image file when ``annotated_size`` is None.

        ``on_video``: as it is in the video that the image file was made of.
        """
        lens = frame.undistort if isinstance(frame.undistort, Undistortion | Upright) else None
        origin = frame.origin.resampled if frame.origin and on_video else None
        if isinstance(origin, Upright) and not isinstance(lens, Upright):
            lens = replace(origin, lenses=(*origin.lenses, lens)) if lens else origin
        pinhole_size = (frame.camera.width, frame.camera.height)
        view = cls(name, lens, pinhole_size, (0, 0), frame.camera.annotation_scale)
        return replace(view, annotated_size=annotated_size or view.shown_size)

    @property
    def file_size(self) -> tuple[int, int]:
        """(width, height) px of the image file."""
        return (self.lens.width, self.lens.height) if self.lens else self.pinhole_size

    @property
    def shown_size(self) -> tuple[int, int]:
        """(width, height) px of the image as a viewer shows it."""
        return self.lens.shown_size if isinstance(self.lens, Upright) else self.file_size

    @property
    def drawn_on_shown(self) -> bool:
        """Whether the drawing is of the image as shown, and not of its pixels as stored, which differ.

        Annotation tools show images as their orientation tag asks, so it is, unless its size says otherwise.
        """
        if not isinstance(self.lens, Upright) or self.lens.shown == AS_STORED:
            return False
        return _same_shape(self.annotated_size, self.shown_size)

    @property
    def sizes_cannot_tell(self) -> bool:
        """Whether the image has the same shape as shown and as stored: turned by 180°, mirrored, or square."""
        return _same_shape(self.shown_size, self.file_size)

    @property
    def drawn_size(self) -> tuple[int, int]:
        """(width, height) px of the image that was drawn on, if no copy of another size was."""
        return self.shown_size if self.drawn_on_shown else self.file_size

    @property
    def has_other_shape(self) -> bool:
        """Whether the drawing can be of this image neither as shown nor as stored."""
        return not _same_shape(self.annotated_size, self.drawn_size)

    def to_pinhole(self, points_px: FloatArray) -> FloatArray:
        """(N, 2) pixels of the image file → (N, 2) of the pinhole one."""
        return self.lens.points(points_px) if self.lens else points_px

    def to_file(self, points_px: FloatArray) -> FloatArray:
        """(N, 2) pixels drawn → (N, 2) of the image file."""
        if self.annotated_size != self.drawn_size:
            points_px = points_px * (np.array(self.drawn_size) / self.annotated_size)
        return self.lens.from_shown(points_px) if isinstance(self.lens, Upright) and self.drawn_on_shown else points_px

    def to_drawn(self, points_px: FloatArray) -> FloatArray:
        """(N, 2) pixels of the pinhole image → (N, 2) as they would be drawn: the inverse of both."""
        if isinstance(self.lens, Upright):
            points_px = self.lens.stored(points_px)
            points_px = self.lens.shown.points(points_px, self.lens.size) if self.drawn_on_shown else points_px
        elif self.lens:
            points_px = self.lens.distorted(points_px)
        return points_px * (np.array(self.annotated_size) / self.drawn_size)


def region(polygons: Sequence[FloatArray], view: View, where: str, repairs: Repairs) -> MultiPolygon:
    """The union of (N, 2) outlines, in the pinhole image, without redundant vertices.

    ``where`` begins the messages about them.
    """
    pieces = [_polygon(points_px, view, where, repairs) for points_px in polygons]
    tolerance_px = REDUNDANT_PX * view.annotation_scale
    whole = without_redundant_vertices(united([piece for piece in pieces if not piece.is_empty]), tolerance_px)
    few = few_vertices(whole, tolerance_px)
    if few is not whole:
        repairs.lines.append(f"{where}: {_coarser(shapely.get_num_coordinates(whole), 'vertices', few is not None)}")
    return NOTHING if few is None else few


def polyline(points_px: FloatArray, view: View, repairs: Repairs) -> list[FloatArray]:
    """The parts of an (N, 2) polyline within the image, in the pinhole image."""
    if _distinct(points_px) < 2:
        repairs.lines.append(f"{view.name}: occlusion edge with fewer than 2 points dropped")
        return []
    image = shapely.box(0, 0, *view.file_size)
    few = _few(points_px, view, f"{view.name}, occlusion edge", repairs, crosses=True)
    if few is None:
        return []
    line: BaseGeometry = LineString(view.to_file(few))
    if not image.covers(line):
        line = shapely.line_merge(line & image)
    pieces = [
        view.to_pinhole(np.array(part.coords)) for part in shapely.get_parts(line) if isinstance(part, LineString)
    ]
    return [piece for piece in pieces if np.all(np.isfinite(piece))]


def without_redundant_vertices(whole: MultiPolygon, tolerance_px: float) -> MultiPolygon:
    """Polygons of more than ``MOST_CLICKED`` vertices simplified; no outline moves by more than the tolerance.

    A vertex at which a ring begins stays, so rings begin at a corner that does not depend on how they were drawn.
    """
    fine = [shapely.get_num_coordinates(part) > MOST_CLICKED for part in whole.geoms]
    if not any(fine):
        return whole
    simplified = [
        shapely.simplify(shapely.normalize(part), tolerance_px) if is_fine else part
        for part, is_fine in zip(whole.geoms, fine, strict=True)
    ]
    # Parts side by side may touch now.
    return united(simplified)


def united(regions: Sequence[BaseGeometry]) -> MultiPolygon:
    """The union of regions, without pieces smaller than a pixel."""
    return polygonal(shapely.union_all(regions)) if regions else NOTHING


def polygonal(geometry: BaseGeometry) -> MultiPolygon:
    """The polygons in a geometry, without those smaller than a pixel."""
    parts = [geometry] if isinstance(geometry, Polygon) else shapely.get_parts(shapely.get_parts(geometry))
    large = [part for part in parts if isinstance(part, Polygon) and part.area >= MIN_AREA_PX2]
    return MultiPolygon(large) if large else NOTHING


def _polygon(points_px: FloatArray, view: View, where: str, repairs: Repairs) -> MultiPolygon:
    if _distinct(points_px) < 3:
        repairs.lines.append(f"{where}: polygon with fewer than 3 points dropped")
        return NOTHING
    polygon = _simple(points_px, view, where, repairs)
    if polygon.is_empty:
        return NOTHING
    # Clipped before undistortion: off the image a lens model means nothing.
    bounds_px = polygon.bounds
    inside = polygonal(
        polygon if _within(bounds_px, view.file_size, 0) else polygon & shapely.box(0, 0, *view.file_size)
    )
    if inside.is_empty:
        repairs.lines.append(f"{where}: polygon off the image dropped")
        return inside
    repairs.overhanging += not _within(bounds_px, view.file_size, OVERHANG_PX)
    if view.lens is None:
        return inside
    # Vertices only: what is straight in the room is straight between undistorted vertices.
    straight = shapely.transform(inside, view.to_pinhole)
    if not np.all(np.isfinite(shapely.get_coordinates(straight))):
        repairs.lines.append(f"{where}: polygon dropped, the lens model has no inverse at one of its points")
        return NOTHING
    return polygonal(_valid(straight) & shapely.box(0, 0, *view.pinhole_size))


def _simple(points_px: FloatArray, view: View, where: str, repairs: Repairs) -> BaseGeometry:
    """The polygon in the image file, without crossings; empty, and said why, where nothing is left."""
    few = _few(points_px, view, where, repairs)
    if few is not None and len(few) > MAX_CROSSING and not shapely.polygons(few).is_valid:
        few = _few(few, view, where, repairs, crosses=True)
    if few is None or len(few) < 3:
        return NOTHING
    polygon: BaseGeometry = shapely.polygons(view.to_file(few))
    if not polygon.is_valid:
        polygon = polygonal(_valid(polygon))
        what = "polygon without area dropped" if polygon.is_empty else "self-crossing polygon repaired"
        repairs.lines.append(f"{where}: {what}")
    return polygon


def _few(
    points_px: FloatArray, view: View, where: str, repairs: Repairs, *, crosses: bool = False
) -> FloatArray | None:
    """The (N, 2) points as drawn, or fewer where they are too many; None, and why, where fewer are another shape."""
    scale = view.annotated_size[0] / view.pinhole_size[0]
    few = (few_crossings if crosses else few_points)(points_px, REDUNDANT_PX * view.annotation_scale * scale)
    if few is None or len(few) < len(points_px):
        what = "points, of lines that cross each other" if crosses else "points"
        repairs.lines.append(f"{where}: {_coarser(len(points_px), what, few is not None)}")
    return few


def _coarser(number: int, what: str, could_be: bool) -> str:
    """What became of an outline of too many points."""
    return f"outline of {number} {what} {'made coarser' if could_be else 'dropped: draw it with fewer'}"


def _same_shape(size: tuple[int, int], other: tuple[int, int]) -> bool:
    return abs(size[0] * other[1] / (size[1] * other[0]) - 1) <= MAX_STRETCH


def _distinct(points_px: FloatArray) -> int:
    return len(set(map(tuple, points_px.tolist())))


def _within(bounds_px: tuple[float, ...], size: tuple[int, int], margin_px: float) -> bool:
    """Whether (x_min, y_min, x_max, y_max) lie in the image or up to a margin off it."""
    x_min, y_min, x_max, y_max = bounds_px
    return min(x_min, y_min) >= -margin_px and x_max <= size[0] + margin_px and y_max <= size[1] + margin_px


def _valid(geometry: BaseGeometry) -> BaseGeometry:
    """``structure`` keeps what a polygon covers twice; the default method would make a hole of it."""
    return shapely.make_valid(geometry, method="structure", keep_collapsed=False)
