"""What a careful annotator would draw on a frame of a synthetic room, without the errors of a hand.

The image is cut along all outlines of the building into faces, each face goes to the surface nearest there, and what
remains is a partition of the image whose neighbours share every corner. All that is drawn is read off that partition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.scene import OPENINGS, BoolArray, Camera, Element, FloatArray, IntArray, KeyFrame
from gtlayout.synth.corners import moved_lines, moved_region, one_corner
from gtlayout.synth.render import Cast, faces_camera, inverse_depth, project_polygon
from gtlayout.synth.room import Room
from gtlayout.synth.surfaces import Surface, host_of

MIN_AREA_SHARE = 1e-3
"""Of the image: nobody draws smaller pieces."""
ERODE_SHARE = 0.01
"""Of the image's width: visible parts keep away from furniture and corners; what remains of a door or window at the
image border is left to its wall when it is not even twice as wide."""
SIMPLIFY_PX = 1.5
CONTACT_M = 0.01
"""Neighbours in the image touch where they are no further apart along the ray."""
RELIEF_M = 0.15
"""Neighbours with trim touch where either is no further off the other's plane, and …"""
RELIEF_REACH_M = 0.5
"""… they are no further apart along the ray, which may run along that plane."""
_GRID_PX = 1e-5
"""Corners closer than this are one."""
_STRAIGHT_PX = 0.15
"""Corners where hidden outlines cross a boundary are none: those that span a triangle of less than this squared go."""
_CLICKED_PX = 4.0
"""A round wall is drawn with straight lines: corners that span a triangle of less than this squared are left out, so
that its lines are about a pixel off."""
_COPLANAR = 1 - 1e-6


@dataclass(frozen=True)
class Drawing:
    """A building as a camera sees it without furniture: a partition of the image."""

    surfaces: tuple[Surface, ...]
    regions: tuple[MultiPolygon, ...]
    """Of each surface what is seen of it, px, without the openings in it. Neighbours share all corners on their
    common boundary, also those where that boundary ends on a third surface."""
    hosts: tuple[int | None, ...]
    """For each door and window the surface it lies in."""
    trimmed: tuple[bool, ...]
    """Whether a surface has trim or reveals, or is part of another. Trim is in the region of the surface that it is
    drawn with and has none of its own."""

    def whole(self, number: int) -> MultiPolygon:
        """What is seen of a surface together with the openings in it."""
        own = [region for region, host in zip(self.regions, self.hosts, strict=True) if host == number]
        return _polygons(shapely.coverage_union_all([*self.regions[number].geoms, *(p for r in own for p in r.geoms)]))


def annotate(
    room: Room, camera: Camera, hits: Cast, frame: int, rng: np.random.Generator
) -> tuple[KeyFrame, dict[str, str]]:
    """Draw the room's structure, and what of it ``hits`` (one sample a pixel) sees beside the furniture.

    An element is drawn through furniture, as far as other parts of the building do not hide it. Walls are drawn through
    the doors and windows that lie on top of them. Occlusion edges run wherever the building's depth jumps. With trim,
    corners next to each other are one.
    ``rng`` shuffles the ids.
    Returns the key frame and, for each element's id, the name of its surface.
    """
    drawing = draw(room.building, camera)
    lines = occlusion_edges(drawing, camera)
    drawing = _clicked(drawing)
    amodal = {
        number: region
        for number, surface in enumerate(drawing.surfaces)
        if surface.label is not None and not (region := _drawn(drawing, number, camera)).is_empty
    }
    if any(drawing.trimmed):
        by_hand = one_corner(drawing.regions, camera)
        moved = {number: _polygons(moved_region(region, by_hand)) for number, region in amodal.items()}
        amodal = {number: region for number, region in moved.items() if not region.is_empty}
        lines = moved_lines(lines, by_hand)
    elements: list[Element] = []
    names: dict[str, str] = {}
    for number in rng.permutation(list(amodal)):
        surface = room.surfaces[number]
        assert surface.label is not None
        facets = [n for n, s in enumerate(room.surfaces) if s.arc is not None and s.part_of == surface.name]
        visible = visible_parts(np.isin(hits.surface, [number, *facets]))
        elements.append(Element(f"e{len(elements)}", surface.label, amodal[number], visible))
        names[elements[-1].id] = surface.name
    return KeyFrame(frame, tuple(elements), lines), names


def draw(surfaces: tuple[Surface, ...], camera: Camera) -> Drawing:
    """What the camera sees of each of the surfaces, trim included; of coplanar ones the last is on top."""
    image = shapely.box(0, 0, camera.width, camera.height)
    outlines = [_outline(surface, camera) for surface in surfaces]
    # All in one go on a grid: neighbours' edges lie on top of each other but for rounding, which upsets overlays.
    lines = shapely.union_all([image.exterior, *(outline.boundary for outline in outlines)], grid_size=_GRID_PX)
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    inside = shapely.point_on_surface(faces)
    faces, inside = faces[image.contains(inside)], inside[image.contains(inside)]
    drawn_with = _drawn_with(surfaces)
    nearest = _nearest(surfaces, outlines, camera, shapely.get_coordinates(inside))
    owners = np.where(nearest >= 0, drawn_with[nearest], -1)
    seen = np.unique(owners[owners >= 0])
    merged = shapely.coverage_simplify(
        [shapely.coverage_union_all(faces[owners == number]) for number in seen], _STRAIGHT_PX
    )
    regions = [MultiPolygon()] * len(surfaces)
    for number, region in zip(seen, merged, strict=True):
        regions[number] = _polygons(region)
    hosts = tuple(host_of(surfaces, number) for number in range(len(surfaces)))
    whole = {surface.part_of for surface in surfaces if surface.arc is None}
    trimmed = tuple(
        (surface.part_of is not None and surface.arc is None) or surface.name in whole for surface in surfaces
    )
    return Drawing(surfaces, tuple(regions), hosts, trimmed)


def occlusion_edges(drawing: Drawing, camera: Camera) -> tuple[FloatArray, ...]:
    """(N, 2) px polylines along which neighbours are apart in space.

    Also where neither is worth drawing: what is drawn beyond a narrow one must not seem to touch. A person takes what
    trim joins for touching, such as a floor and the wall behind a baseboard.
    """
    owner: dict[tuple[float, ...], int] = {}
    for number, region in enumerate(drawing.regions):
        # Shells turn one way, holes the other: neighbours run along an edge in opposite directions.
        for ring in shapely.get_rings(shapely.get_parts(shapely.orient_polygons(region))):
            corners = shapely.get_coordinates(ring)
            for start, end in pairwise(corners):
                owner[*start, *end] = number
    apart = []
    for (*start, x, y), first in owner.items():
        second = owner.get((x, y, *start))
        if second is None or second < first:
            continue
        points = np.linspace(start, (x, y), 5)[1:-1]
        depths = [1 / _inverse_depth(drawing, number, camera, points) for number in (first, second)]
        rays = np.linalg.norm(camera.rays_world(points), axis=1)
        jump_m = float((np.abs(depths[0] - depths[1]) * rays).max())
        if jump_m > CONTACT_M and not _joined_by_trim(drawing, (first, second), camera, points, jump_m):
            apart.append((start, (x, y)))
    merged = shapely.get_parts(shapely.line_merge(shapely.multilinestrings(apart))) if apart else []
    return tuple(shapely.get_coordinates(line) for line in merged)


def _inverse_depth(drawing: Drawing, number: int, camera: Camera, points_px: FloatArray) -> FloatArray:
    """(N,) inverse depths of a surface at (N, 2) px, 1/m: of a round wall those of the facet that each ray meets."""
    wall = drawing.surfaces[number]
    if wall.arc is None:
        return inverse_depth(wall, camera, points_px)
    facets = [s for s in drawing.surfaces if s is wall or (s.arc is not None and s.part_of == wall.name)]
    inverse = np.stack([inverse_depth(facet, camera, points_px) for facet in facets])
    beside = np.full_like(inverse, np.inf)
    for n, facet in enumerate(facets):
        ahead = (inverse[n] > 0) & faces_camera(facet, camera)
        at = camera.center_world + camera.rays_world(points_px[ahead]) / inverse[n, ahead, None]
        u = facet.frame.to_plane(at)[:, 0]
        beside[n, ahead] = np.maximum(0, np.maximum(-u, u - facet.corners_uv[:, 0].max()))
    return inverse[np.argmin(beside, axis=0), np.arange(len(points_px))]


def _clicked(drawing: Drawing) -> Drawing:
    """With round walls, and all they meet, drawn with as few straight lines as a person would click."""
    if all(surface.arc is None for surface in drawing.surfaces):
        return drawing
    seen = [number for number, region in enumerate(drawing.regions) if not region.is_empty]
    regions = list(drawing.regions)
    simpler = shapely.coverage_simplify([regions[number] for number in seen], _CLICKED_PX)
    for number, region in zip(seen, simpler, strict=True):
        regions[number] = _polygons(region)
    return replace(drawing, regions=tuple(regions))


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
    parts = _polygons(shapely.union_all(outer) - shapely.union_all(holes)).geoms
    return MultiPolygon([part for part in parts if part.area >= MIN_AREA_SHARE * height * width])


def _drawn(drawing: Drawing, number: int, camera: Camera) -> MultiPolygon:
    """What an annotator draws of a surface, px; empty when it is not worth it."""
    least = MIN_AREA_SHARE * camera.width * camera.height
    region = MultiPolygon([part for part in drawing.whole(number).geoms if part.area >= least])
    sliver = drawing.surfaces[number].label in OPENINGS and region.buffer(-ERODE_SHARE * camera.width).is_empty
    return MultiPolygon() if sliver else region


def _joined_by_trim(
    drawing: Drawing, pair: tuple[int, int], camera: Camera, points_px: FloatArray, jump_m: float
) -> bool:
    """Whether neighbours that are up to ``jump_m`` apart along the rays of (N, 2) px touch in a person's mind."""
    first, second = pair
    if not (drawing.trimmed[first] or drawing.trimmed[second]):
        return False
    if drawing.hosts[first] == second or drawing.hosts[second] == first:
        return True
    rays = camera.rays_world(points_px)
    off_m = []
    for number, other in (pair, pair[::-1]):
        depth = 1 / _inverse_depth(drawing, number, camera, points_px)
        plane = drawing.surfaces[other]
        off_m.append(np.abs((camera.center_world + depth[:, None] * rays) @ plane.normal + plane.d).max())
    return bool(jump_m <= RELIEF_REACH_M and min(off_m) <= RELIEF_M)


def _drawn_with(surfaces: Sequence[Surface]) -> IntArray:
    """(N,) for each surface the one in whose region it is drawn: itself, or that which it is the trim of."""
    numbers = {surface.name: number for number, surface in enumerate(surfaces)}
    return np.array(
        [
            numbers[surface.part_of] if surface.label is None and surface.part_of is not None else number
            for number, surface in enumerate(surfaces)
        ]
    )


def _outline(surface: Surface, camera: Camera) -> MultiPolygon:
    """A surface's projection without its holes, px, as if nothing hid it."""
    if not faces_camera(surface, camera):
        return MultiPolygon()
    outline = _filled(project_polygon(camera, surface.corners_world))
    for hole in surface.holes_world:
        outline = _polygons(outline - _filled(project_polygon(camera, hole)))
    return outline


def _filled(ring_px: FloatArray) -> MultiPolygon:
    """A polygon cut at the near plane may run there and back along the cut."""
    return _polygons(shapely.make_valid(Polygon(ring_px))) if len(ring_px) >= 3 else MultiPolygon()


def _nearest(
    surfaces: Sequence[Surface], outlines: Sequence[shapely.Geometry], camera: Camera, points: FloatArray
) -> IntArray:
    """(N,) the surface that (N, 2) px show, -1 for none."""
    found = np.full(len(points), -1, np.int64)
    nearest = np.full(len(points), 1e-9)
    for number, (surface, outline) in enumerate(zip(surfaces, outlines, strict=True)):
        if outline.is_empty:
            continue
        shapely.prepare(outline)
        inverse = inverse_depth(surface, camera, points)
        wins = shapely.contains_xy(outline, points) & (inverse > nearest * _COPLANAR)
        found[wins], nearest[wins] = number, inverse[wins]
    return found


def _polygons(geometry: shapely.Geometry) -> MultiPolygon:
    parts = shapely.get_parts(shapely.get_parts(geometry))
    return MultiPolygon([part for part in parts if isinstance(part, Polygon) and not part.is_empty])
