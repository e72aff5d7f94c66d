"""Extents on cylinders: what key frames draw is unrolled, put to the vote there, and floors end at the arc."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.consensus import Faces, own_members, straight
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import homogeneous, polygons
from gtlayout.geometry.strip import StripFrame, unproject_onto
from gtlayout.instances import Instance, Plane, PlaneFrame
from gtlayout.scene import BoolArray, Camera, FloatArray, Scene

_STEP_PX = 4.0
"""Lines in the image are straight, and bend on the strip: they get a corner so often."""
_LEAST_CORNERS = 3
_DEEP = 0.5
"""What a floor has beyond an arc is looked for to this share of its radius."""


def lift(region_px: BaseGeometry, strip: StripFrame, camera: Camera, max_depth: float) -> MultiPolygon:
    """An image region on the strip."""
    found = []
    for part in polygons(region_px).geoms:
        rings = [_along(ring, strip, camera, max_depth) for ring in (part.exterior, *part.interiors)]
        if len(rings[0]) >= _LEAST_CORNERS:
            found.append(polygons(Polygon(rings[0], [hole for hole in rings[1:] if len(hole) >= _LEAST_CORNERS])))
    return polygons(shapely.union_all(found))


def lift_line(line_px: BaseGeometry, strip: StripFrame, camera: Camera, max_depth: float) -> BaseGeometry:
    """Lines of the image on the strip."""
    runs = [_along(part, strip, camera, max_depth) for part in shapely.get_parts(line_px)]
    return shapely.union_all([LineString(run) for run in runs if len(run) > 1])


def _along(line_px: BaseGeometry, strip: StripFrame, camera: Camera, max_depth: float) -> FloatArray:
    """(N, 2) places on the strip along a line of the image."""
    points_px = shapely.get_coordinates(shapely.segmentize(line_px, _STEP_PX))
    found = unproject_onto(points_px, strip, camera, max_depth)
    return found[np.isfinite(found).all(axis=1)]


def faces_on(
    scene: Scene,
    instances: Sequence[Instance],
    index: int,
    planes: Sequence[Plane],
    strip: StripFrame,
    max_depth: float,
    grid: float,
    config: ExtentConfig,
) -> Faces:
    """As ``consensus.faces_of``, on the strip of a curved wall: each face is judged at a point in it."""
    own, frames = own_members(instances, index), range(len(scene.key_frames))
    instance_of = {member: i for i, one in enumerate(instances) for member in one.members}
    mine, theirs = [], []
    for k in frames:
        elements, camera = scene.key_frames[k].elements, scene.frame_of(k).camera
        drawn = shapely.union_all([element.amodal for e, element in enumerate(elements) if (k, e) in own])
        mine.append(lift(drawn, strip, camera, max_depth))
        others = [
            (planes[instance_of[k, e]], lift(shapely.difference(element.amodal, drawn), strip, camera, max_depth))
            for e, element in enumerate(elements)
            if (k, e) not in own and (k, e) in instance_of and planes[instance_of[k, e]].observable
        ]
        theirs.append([one for one in others if not one[1].is_empty])
    boundaries = [region.boundary for region in mine] + [region.boundary for all_ in theirs for _, region in all_]
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(boundaries, grid_size=grid)]))
    inside = shapely.get_coordinates(shapely.point_on_surface(faces))
    seen: BoolArray = np.zeros((len(mine), len(inside)), dtype=bool)
    contradicted = seen.copy()
    for k in frames:
        seen[k] = shapely.contains_xy(mine[k], inside)
        for plane, region in theirs[k]:
            covers = shapely.contains_xy(region, inside)
            contradicted[k] |= covers & _not_nearer(plane, strip.to_world(inside), scene.frame_of(k).camera, config)
    return Faces(faces, seen, contradicted, grid)


def _not_nearer(plane: Plane, points_world: FloatArray, camera: Camera, config: ExtentConfig) -> BoolArray:
    """(N,) whether a plane lies, where a camera sees (N, 3) points, on or behind them."""
    if not len(points_world):
        return np.zeros(0, dtype=bool)
    points_px, depth = camera.project(points_world)
    inverse = homogeneous(points_px) @ inverse_depth(plane, camera)
    behind: BoolArray = inverse * np.maximum(depth, 1e-12) <= 1 / (1 - config.occluder_margin)
    return behind


def tangent_plane(strip: StripFrame, wall: Plane, contact_uv: BaseGeometry) -> Plane:
    """The plane that touches a cylinder where it meets an upright wall, along their contact on the strip."""
    at = strip.onto(wall, np.median(shapely.get_coordinates(contact_uv), axis=0))
    normal = strip.normal_at(at)
    point = strip.to_world(at[None])[0]
    return Plane(normal, -float(normal @ point), np.full((4, 4), np.nan), observable=True)


def up_to_arc(
    region: MultiPolygon,
    frame: PlaneFrame,
    plane: Plane,
    strip: StripFrame,
    between_u: tuple[float, float],
    contact: BaseGeometry,
    grid: float,
    config: ExtentConfig,
) -> MultiPolygon:
    """A floor's or ceiling's region up to the arc of a curved wall: both 10 % rules, as ``refine`` has them for planes.

    Args:
        frame: that of ``region`` and ``contact``, on ``plane``.
        between_u: from where to where on the strip the wall goes.
    """
    low, high = between_u
    u = np.array([low, *strip.borders(low, high), high])
    uv = np.array([strip.onto(plane, np.array([place, 0.0])) for place in u])
    uv[:, 0] = u
    arc = frame.to_plane(strip.to_world(uv))
    center = _center(strip, plane, frame)
    reach = 2 * float(shapely.distance(shapely.points(shapely.get_coordinates(contact)), LineString(arc)).max())
    radius = strip.cylinder.radius
    share = np.clip(reach / radius, 0.0, _DEEP)
    room, away = (1 - share, 1 + _DEEP) if strip.concave else (1 + share, 1 - _DEEP)
    gap = polygons(shapely.difference(_between(arc, center, room), region, grid_size=grid))
    if gap.area <= config.max_growth * region.area:
        region = straight(shapely.union(region, gap, grid_size=grid), grid)
    beyond = polygons(shapely.intersection(region, _between(arc, center, away), grid_size=grid))
    if beyond.area <= config.max_cut * region.area:
        region = straight(shapely.difference(region, beyond, grid_size=grid), grid)
    return region


def _center(strip: StripFrame, plane: Plane, frame: PlaneFrame) -> FloatArray:
    """(2,) where the axis passes through a floor or ceiling."""
    cylinder = strip.cylinder
    point, axis = cylinder.axis_point_world, cylinder.axis_world
    foot = point - (plane.normal @ point + plane.d) / (plane.normal @ axis) * axis
    return np.asarray(frame.to_plane(foot[None])[0])


def _between(arc: FloatArray, center: FloatArray, share: float) -> MultiPolygon:
    """What lies between an arc and the same with another radius."""
    return polygons(Polygon([*arc, *(center + share * (arc - center))[::-1]]))
