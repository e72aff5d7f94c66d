"""What a careful annotator would draw on a frame of a synthetic room."""

from __future__ import annotations

import cv2
import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.scene import OPENINGS, BoolArray, Camera, Element, FloatArray, KeyFrame
from gtlayout.synth_render import Cast, faces_camera, project_polygon
from gtlayout.synth_room import Room

MIN_AREA_SHARE = 1e-3
"""Of the image: nobody draws smaller pieces."""
ERODE_SHARE = 0.01
"""Of the image's width: visible parts keep away from furniture and corners; what remains of a door or window at the
image border is left to its wall when it is not even twice as wide."""
SIMPLIFY_PX = 1.5


def annotate(
    room: Room, camera: Camera, hits: Cast, frame: int, jitter_sigma_px: float, rng: np.random.Generator
) -> tuple[KeyFrame, dict[str, str]]:
    """Draw a convex room's structure, and what of it ``hits`` (one sample a pixel) sees beside the furniture.

    Walls are drawn through doors, windows and furniture; doors and windows lie on top of their wall. The hand's error
    is one shift per corner: elements that share it stay together, and their common edge is off as a whole. Ids are
    shuffled.
    Returns the key frame and, for each element's id, the name of its surface.
    """
    shifts: dict[tuple[int, int], FloatArray] = {}
    drawn: list[tuple[int, MultiPolygon]] = []
    for number, surface in enumerate(room.surfaces):
        if surface.label is None or not faces_camera(surface, camera):
            continue
        outline = project_polygon(camera, surface.corners_world)
        if len(outline) < 3:
            continue
        seen = _polygons(Polygon(outline) & shapely.box(0, 0, camera.width, camera.height))
        amodal = MultiPolygon([_by_hand(part, shifts, camera, jitter_sigma_px, rng) for part in seen])
        sliver = surface.label in OPENINGS and amodal.buffer(-ERODE_SHARE * camera.width).is_empty
        if amodal.area >= MIN_AREA_SHARE * camera.width * camera.height and not sliver:
            drawn.append((number, amodal))

    elements: list[Element] = []
    names: dict[str, str] = {}
    for at in rng.permutation(len(drawn)):
        number, amodal = drawn[at]
        surface = room.surfaces[number]
        assert surface.label is not None
        element = Element(f"e{len(elements)}", surface.label, amodal, visible_parts(hits.surface == number))
        elements.append(element)
        names[element.id] = surface.name
    return KeyFrame(frame, tuple(elements)), names


def visible_parts(mask: BoolArray) -> MultiPolygon:
    """Rough polygons well within an (height, width) mask."""
    height, width = mask.shape
    reach = max(1, round(ERODE_SHARE * width))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    eroded = cv2.erode(mask.astype(np.uint8), kernel)
    contours, hierarchy = cv2.findContours(eroded, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outer: list[shapely.Geometry] = []
    holes: list[shapely.Geometry] = []
    for number, contour in enumerate(contours):
        corners = cv2.approxPolyDP(contour, SIMPLIFY_PX, closed=True).reshape(-1, 2)
        if len(corners) >= 3:
            # OpenCV counts from the centre of the first pixel.
            (outer if hierarchy[0, number, 3] < 0 else holes).append(shapely.make_valid(Polygon(corners + 0.5)))
    parts = _polygons(shapely.union_all(outer) - shapely.union_all(holes))
    return MultiPolygon([part for part in parts if part.area >= MIN_AREA_SHARE * height * width])


def _by_hand(
    polygon: Polygon,
    shifts: dict[tuple[int, int], FloatArray],
    camera: Camera,
    jitter_sigma_px: float,
    rng: np.random.Generator,
) -> Polygon:
    """The polygon with every corner shifted; ``shifts`` remembers corners already drawn in this frame."""
    size = np.array([camera.width, camera.height])
    corners = np.array(polygon.exterior.coords)[:-1]
    moved = np.empty_like(corners)
    for number, corner in enumerate(corners):
        key = round(corner[0] * 100), round(corner[1] * 100)
        if key not in shifts:
            shifts[key] = rng.normal(0, jitter_sigma_px, 2)
        # Where an edge leaves the image the hand slides along the border.
        on_border = (corner < 1e-6) | (corner > size - 1e-6)
        moved[number] = np.clip(corner + np.where(on_border, 0, shifts[key]), 0, size)
    drawn = Polygon(moved)
    return drawn if drawn.is_valid else polygon


def _polygons(geometry: shapely.Geometry) -> list[Polygon]:
    return [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon) and not part.is_empty]
