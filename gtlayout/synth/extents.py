"""The true extent of a synthetic room's surfaces: the part of each that its key frames show."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.geometry.polygons import polygons
from gtlayout.geometry.raster import rings_of
from gtlayout.scene import Camera, FloatArray, KeyFrame
from gtlayout.synth.render import uv1_over_z
from gtlayout.synth.room import Room
from gtlayout.synth.surfaces import Surface

_GRID_M = 1e-5
_STRAIGHT_M = 1e-4
"""Corners of single views on a straight part of the union are no further off it."""
_MIN_AREA_M2 = 1e-4
"""Smaller pieces and holes are rounding."""


def seen_extents(
    room: Room, views: Iterable[tuple[Camera, KeyFrame, Mapping[str, str]]]
) -> dict[str, list[list[FloatArray]]]:
    """What key frames show of each surface drawn in them, furniture thought away.

    ``views`` are true cameras, exact key frames (see ``synth_annotate.annotate``) and the surface's name for each of
    their elements' ids. A wall's extent includes its doors and windows, and trim that it is drawn with.
    Round walls have none.
    Returns polygons by surface name, each as its shell and holes, rings of (N, 3) points, m.
    """
    by_name = {surface.name: surface for surface in room.structure}
    seen: dict[str, list[MultiPolygon]] = defaultdict(list)
    for camera, key_frame, names in views:
        for element in key_frame.elements:
            surface = by_name[names[element.id]]
            if surface.arc is not None:
                continue
            seen[surface.name].append(_on_surface(element.amodal, surface, camera))
    extents = {}
    for name, surface in by_name.items():
        if name in seen:
            union = shapely.union_all(seen[name], grid_size=_GRID_M)
            region = shapely.intersection(union, _drawn_as(surface, room), grid_size=_GRID_M)
            parts = _tidy(region.simplify(_STRAIGHT_M))
            extents[name] = [[surface.frame.to_world(ring) for ring in rings_of(MultiPolygon([p]))] for p in parts]
    return extents


def _drawn_as(surface: Surface, room: Room) -> shapely.Geometry:
    """All that can be drawn of a surface, on its plane: itself, and right before or behind it what is drawn with it."""
    trim = [surface.frame.to_plane(part.corners_world) for part in room.building if part.part_of == surface.name]
    if not trim:
        return Polygon(surface.corners_uv)
    # Those at right angles to the surface have no width on it.
    upon_it = polygons(shapely.union_all([shapely.make_valid(Polygon(corners)) for corners in trim]))
    return polygons(shapely.union_all([Polygon(surface.corners_uv), upon_it], grid_size=_GRID_M))


def _on_surface(region_px: MultiPolygon, surface: Surface, camera: Camera) -> MultiPolygon:
    uv_from_px = uv1_over_z(surface, camera)

    def unproject(points_px: FloatArray) -> FloatArray:
        homogeneous = np.column_stack([points_px, np.ones(len(points_px))]) @ uv_from_px.T
        return homogeneous[:, :2] / homogeneous[:, 2:]

    return polygons(shapely.transform(region_px, unproject))


def _tidy(region: shapely.Geometry) -> list[Polygon]:
    return [
        Polygon(part.exterior, [hole for hole in part.interiors if Polygon(hole).area >= _MIN_AREA_M2])
        for part in shapely.get_parts(region)
        if isinstance(part, Polygon) and part.area >= _MIN_AREA_M2
    ]
