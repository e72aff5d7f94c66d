"""A layout as a building: bodies behind its surfaces, with openings cut, and rooms. Geometry only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.export.round_wall import ArcBody, arc_body, slabs
from gtlayout.export.shell import Surface, bodies
from gtlayout.export.solid import Solid, between
from gtlayout.export.upright import outline_in
from gtlayout.geometry.polygons import half_plane, polygons
from gtlayout.geometry.strip import StripFrame, strip_of
from gtlayout.instances import Dimension, Extent, PlaneFrame
from gtlayout.layout import Layout
from gtlayout.scene import OPENINGS, FloatArray

MIN_AREA_SHARE = 1e-6
"""What is left of a surface beside its openings below this share of its area is rounding."""
MAX_BELOW = 0.5
"""A slanted surface or second ceiling that passes this far below another one, in nominal thicknesses, bounds only a
part of the room, and which part was not seen."""
MIN_COVERED = 0.5
"""Slanted surfaces alone close a room upwards when they are above this share of its floor."""
_UPRIGHT = 1e-6
"""Planes whose normal is this near to upright are level: they have no direction upwards."""
_LEVEL = 1e-9
"""Slopes below it are level."""
_LEAST_HEIGHT = 0.01
"""A room's body is nowhere lower than this, in nominal thicknesses."""


@dataclass(frozen=True)
class Part:
    """A wall, floor, ceiling or slanted surface, or what was inferred of it, with its body."""

    instance: int
    inferred: bool
    extent: Extent
    net_area: float
    """Without the openings."""
    solids: tuple[Solid, ...]
    """In the extent's frame: (u, v, along the normal); of a curved wall that of the plane that touches it."""
    arc: ArcBody | None = None
    """Of a curved wall without openings, in place of the solids."""


@dataclass(frozen=True)
class Opening:
    """The hole of a door or window in its host."""

    instance: int
    host: int
    outline: MultiPolygon
    """In the frame of the host's extent."""


@dataclass(frozen=True)
class Room:
    """What is above one floor."""

    floor: int
    """Index of an instance."""
    outline: MultiPolygon
    """In the frame of the floor's extent: what was seen of it, and what was inferred."""
    inferred_area: float
    height: Dimension | None
    """To the ceiling with most of its area above the floor."""
    solids: tuple[Solid, ...]
    """In the same frame; none where nothing is known to be above."""
    left_out: tuple[int, ...]
    """Indices of surfaces above it that do not bound the body."""


def openings(layout: Layout, extents: Sequence[Extent]) -> dict[int, Opening]:
    """By instance. A door or window whose outline, dropped onto its host's plane, is not on the host has none."""
    found = {}
    for i, instance in enumerate(layout.instances):
        if instance.host is not None and not (extents[i].region.is_empty or extents[instance.host].region.is_empty):
            outline = outline_in(extents[instance.host], extents[i])
            if outline.intersection(extents[instance.host].region).area > 0:
                found[i] = Opening(i, instance.host, outline)
    return found


def parts(
    layout: Layout,
    extents: Sequence[Extent],
    inferred: Sequence[Extent],
    holes: Sequence[Opening],
    thickness: float,
) -> list[Part]:
    """Everything with a body, but doors and windows: first what was seen, then what was inferred, then curved walls.

    No corner of a flat wall is mitred against a curved one.
    """
    layers = [(i, False, extent) for i, extent in enumerate(extents) if layout.instances[i].label not in OPENINGS]
    layers += [
        (i, True, Extent(extent.frame, _without(extent.region, extents[i].region), extent.unrefined))
        for i, extent in enumerate(inferred)
    ]
    placed = [layer for layer in layers if not layer[2].region.is_empty and strip_of(layer[2]) is None]
    surfaces = []
    for i, _, extent in placed:
        surfaces.append(Surface(extent.frame, extent.region, _solid(i, extent, holes), thickness))
    flat = [
        Part(i, is_inferred, extent, float(surface.solid.area), solids)
        for (i, is_inferred, extent), surface, solids in zip(placed, surfaces, bodies(surfaces), strict=True)
    ]
    return flat + [
        _curved(i, extent, strip, _solid(i, extent, holes), thickness)
        for i, _, extent in layers
        if (strip := strip_of(extent)) and not extent.region.is_empty
    ]


def _solid(i: int, extent: Extent, holes: Sequence[Opening]) -> MultiPolygon:
    """What of an extent is not cut out."""
    return _without(extent.region, shapely.union_all([hole.outline for hole in holes if hole.host == i]))


def _curved(i: int, extent: Extent, strip: StripFrame, solid: MultiPolygon, thickness: float) -> Part:
    arc = arc_body(solid, strip, thickness)
    return Part(i, False, extent, float(solid.area), () if arc else slabs(solid, strip, thickness), arc)


def rooms(layout: Layout, extents: Sequence[Extent], inferred: Sequence[Extent], thickness: float) -> list[Room]:
    """One for each floor whose place is known."""
    floors = [i for i, one in enumerate(layout.instances) if one.label == "floor" and not extents[i].region.is_empty]
    return [_room(layout, extents, inferred, i, thickness) for i in floors]


def _room(layout: Layout, extents: Sequence[Extent], inferred: Sequence[Extent], floor: int, thickness: float) -> Room:
    seen = extents[floor].region
    added = _without(inferred[floor].region, seen) if inferred else MultiPolygon()
    outline = polygons(seen.union(added))
    above = _above(layout, extents, floor, outline)
    dimensions = {d.second: d for d in layout.dimensions if d.kind == "height" and d.first == floor}
    height = next((dimensions[i] for i in above if i in dimensions), None)
    tops: list[int] = []
    for i in above:
        if all(_below(extents, floor, i, j) <= MAX_BELOW * thickness for j in tops) and all(
            _below(extents, floor, j, i) <= MAX_BELOW * thickness for j in tops
        ):
            tops.append(i)
    if not any(layout.instances[i].label == "ceiling" for i in tops):
        covered = shapely.union_all([outline_in(extents[floor], extents[i]) for i in tops]).intersection(outline).area
        tops = tops if covered >= MIN_COVERED * outline.area else []
    planes: list[FloatArray] = []
    for i in tops:
        plane = _height_above(extents[floor], extents[i])
        if not any(np.allclose(plane, other) for other in planes):
            planes.append(plane)
    left_out = tuple(i for i in above if i not in tops)
    return Room(floor, outline, float(added.area), height, _under(outline, planes, _LEAST_HEIGHT * thickness), left_out)


def _above(layout: Layout, extents: Sequence[Extent], floor: int, outline: MultiPolygon) -> list[int]:
    """Ceilings, then slanted surfaces, that lie above a floor: those above most of it first."""
    up = np.cross(*extents[floor].frame.axes)
    found = []
    for label in ("ceiling", "slanted"):
        shares = {}
        for i, instance in enumerate(layout.instances):
            if instance.label == label and not extents[i].region.is_empty:
                faces_down = np.cross(*extents[i].frame.axes) @ up < 0
                over = outline_in(extents[floor], extents[i]).intersection(outline).area
                if faces_down and over > MIN_AREA_SHARE * outline.area:
                    shares[i] = over
        found += sorted(shares, key=lambda i: -shares[i])
    return found


def _height_above(floor: Extent, top: Extent) -> FloatArray:
    """(3,) (a, b, c): the height of a plane above a point (u, v) of the floor is a u + b v + c."""
    normal = np.cross(*top.frame.axes)
    rise = normal @ np.cross(*floor.frame.axes)
    return -np.array([*(floor.frame.axes @ normal), (floor.frame.origin - top.frame.origin) @ normal]) / rise


def _below(extents: Sequence[Extent], floor: int, low: int, high: int) -> float:
    """How far the plane of one surface passes below what was seen of another, over a floor."""
    corners = extents[high].frame.to_world(shapely.get_coordinates(extents[high].region))
    uv1 = np.column_stack([extents[floor].frame.to_plane(corners), np.ones(len(corners))])
    heights = [uv1 @ _height_above(extents[floor], extents[i]) for i in (low, high)]
    return float((heights[1] - heights[0]).max())


def _under(outline: MultiPolygon, tops: list[FloatArray], least: float) -> tuple[Solid, ...]:
    """What is between the floor and the lowest of some planes: a prism under each of them."""
    floor, solids = np.zeros(3), []
    for k, top in enumerate(tops):
        cell = outline
        for bound in [*(other - top for other in tops[:k] + tops[k + 1 :]), top - [0.0, 0.0, least]]:
            if not cell.is_empty:
                cell = _clean(cell.intersection(_where_positive(bound, cell)), outline.area)
        for polygon in cell.geoms:
            turned = shapely.orient_polygons(polygon)
            rings = [shapely.get_coordinates(ring)[:-1] for ring in (turned.exterior, *turned.interiors)]
            solids.append(between([[(point, [point]) for point in ring] for ring in rings], top, floor))
    return tuple(solids)


def _where_positive(value: FloatArray, around: MultiPolygon) -> shapely.Geometry:
    """Where a u + b v + c >= 0, as far as it is ``around``."""
    if np.abs(value[:2]).max() > _LEVEL:
        return half_plane(value, around)
    return around if value[2] >= 0 else MultiPolygon()


def _without(region: MultiPolygon, cut: shapely.Geometry) -> MultiPolygon:
    return _clean(region.difference(cut), region.area)


def _clean(geometry: shapely.Geometry, area: float) -> MultiPolygon:
    """Its polygons, without those that are only rounding beside an area."""
    return MultiPolygon([one for one in polygons(geometry).geoms if one.area > MIN_AREA_SHARE * area])


def overall(frame: PlaneFrame, region: MultiPolygon) -> tuple[float, float]:
    """Height, as far upwards as the plane goes, and width of the rectangle about an outline."""
    points = frame.to_world(shapely.get_coordinates(region))
    normal = np.cross(*frame.axes)
    along = np.cross([0.0, 0.0, 1.0], normal)
    along = frame.axes[0] if np.linalg.norm(along) < _UPRIGHT else along / np.linalg.norm(along)
    return float(np.ptp(points @ np.cross(normal, along))), float(np.ptp(points @ along))


def size_of(extents: Sequence[Extent]) -> float:
    """Length of the box's diagonal about everything; 1 for nothing."""
    points = [extent.frame.to_world(shapely.get_coordinates(extent.region)) for extent in extents]
    everything = np.concatenate(points) if points else np.empty((0, 3))
    return float(np.linalg.norm(np.ptp(everything, axis=0))) if len(everything) else 1.0
