"""A cylinder unrolled: what lies on it has flat coordinates, and is cut into flat facets where planes are wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon, box
from shapely.geometry.base import BaseGeometry

from gtlayout.cylinder import CurvedWall, Cylinder
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Extent, Plane, PlaneFrame
from gtlayout.scene import Camera, FloatArray

_NEWTON = 12


@dataclass(frozen=True)
class StripFrame(PlaneFrame):
    """The unrolled strip of an upright cylinder: u along the arc from its middle, v upwards, both world unit.

    ``origin`` and ``axes`` are those of the plane that touches the cylinder at u = v = 0, so that u × v is the normal
    there, towards the cameras.
    """

    cylinder: Cylinder
    middle_rad: float
    """The angle about the axis at which u is 0, as ``Cylinder.unrolled`` counts."""
    concave: bool
    """Whether cameras see it from within: u runs clockwise from above then."""
    step: float
    """Along u from one border of a facet to the next; one lies at u = 0."""

    @classmethod
    def on(cls, wall: CurvedWall, tolerance: float) -> Self:
        """The strip of a wall, in facets that are nowhere farther off than ``tolerance``, world unit."""
        cylinder, middle = wall.cylinder, sum(wall.arc_rad) / 2
        half = np.arccos(np.clip(1 - tolerance / cylinder.radius, 0.5, 1.0))
        return cls.about(cylinder, middle, wall.concave, 2 * float(half) * cylinder.radius)

    @classmethod
    def about(cls, cylinder: Cylinder, middle_rad: float, concave: bool, step: float) -> Self:
        """The strip that touches the plane at an angle about the axis, radians."""
        origin = cylinder.points(np.array([middle_rad]), np.zeros(1))[0]
        outwards = np.array([np.cos(middle_rad), np.sin(middle_rad)]) @ cylinder.axes[:2]
        up = cylinder.axes[2]
        axes = np.stack([np.cross(up, -outwards if concave else outwards), up])
        return cls(origin, axes, cylinder, middle_rad, concave, step)

    @property
    def sense(self) -> float:
        """1 where u grows with the angle, -1 where it falls."""
        return -1.0 if self.concave else 1.0

    def angles(self, u: FloatArray) -> FloatArray:
        """(N,) angles about the axis at (N,) places along the arc, radians."""
        return self.middle_rad + self.sense * u / self.cylinder.radius

    def arc_rad(self, region: MultiPolygon) -> tuple[float, float]:
        """Between which angles about the axis a region in this frame lies, radians, the first less; NaN for none."""
        if region.is_empty:
            return np.nan, np.nan
        low, _, high, _ = region.bounds
        first, last = sorted(self.angles(np.array([low, high])).tolist())
        return first, last

    def to_world(self, points_uv: FloatArray) -> FloatArray:
        """(N, 2) → (N, 3)."""
        return self.cylinder.points(self.angles(points_uv[:, 0]), points_uv[:, 1])

    def to_plane(self, points_world: FloatArray) -> FloatArray:
        """(N, 3) → (N, 2): level, towards or from the axis; to half a turn from the middle either way."""
        angles, heights, _ = self.cylinder.unrolled(points_world)
        turn = (angles - self.middle_rad + np.pi) % (2 * np.pi) - np.pi
        return np.column_stack([self.sense * turn * self.cylinder.radius, heights])

    def moved(self, scale: float = 1.0, rotation: FloatArray | None = None, shift: FloatArray | None = None) -> Self:
        """In a world whose points are ``scale`` (3, 3) ``rotation`` X + (3,) ``shift``."""
        cylinder = self.cylinder.scaled(scale)
        cylinder = cylinder if rotation is None else cylinder.turned(rotation)
        cylinder = cylinder if shift is None else cylinder.moved(shift)
        return self.about(cylinder, self.middle_rad, self.concave, scale * self.step)

    def by_uv(self, points_uv: FloatArray) -> FloatArray:
        """(N, 2, 3) derivatives of the world points by u and v."""
        angles = self.angles(points_uv[:, 0])
        along = self.sense * np.column_stack([-np.sin(angles), np.cos(angles)]) @ self.cylinder.axes[:2]
        up = self.cylinder.axes[2] + self.cylinder.values[3:] @ self.cylinder.axes[:2]
        return np.stack([along, np.broadcast_to(up, along.shape)], axis=1)

    def normal_at(self, point_uv: FloatArray) -> FloatArray:
        """(3,) unit normal of the surface at (2,), towards the cameras."""
        normal = np.cross(*self.by_uv(point_uv[None])[0])
        return np.asarray(normal / np.linalg.norm(normal))

    def onto(self, plane: Plane, near_uv: FloatArray) -> FloatArray:
        """(2,) a point in which the cylinder meets a plane, the nearest to a (2,) point by small steps."""
        point = near_uv
        for _ in range(_NEWTON):
            value = float(self.to_world(point[None])[0] @ plane.normal) + plane.d
            gradient = self.by_uv(point[None])[0] @ plane.normal
            point = point - value * gradient / max(float(gradient @ gradient), 1e-12)
        return point

    def borders(self, low: float, high: float) -> FloatArray:
        """(N,) borders of facets strictly between two places along the arc."""
        first, last = np.floor(low / self.step) + 1, np.ceil(high / self.step) - 1
        return np.arange(first, last + 1) * self.step


def unproject_onto(points_px: FloatArray, strip: StripFrame, camera: Camera, max_depth: float = np.inf) -> FloatArray:
    """(N, 2) places on the strip at which a camera sees its cylinder at (N, 2) pixels; NaN where that is not before it.

    Beside the cylinder's silhouette that is where the ray passes nearest.
    """
    cylinder, rays = strip.cylinder, camera.rays_world(points_px)
    start, ray = (camera.center_world - cylinder.origin) @ cylinder.axes.T, rays @ cylinder.axes.T
    across = start[:2] - cylinder.values[:2] - start[2] * cylinder.values[3:]
    along = ray[:, :2] - ray[:, 2:] * cylinder.values[3:]
    a, b = np.sum(along**2, axis=1), along @ across
    c = float(across @ across) - cylinder.radius**2
    root = np.sqrt(np.maximum(b**2 - a * c, 0.0))
    depth = (-b + (root if strip.concave else -root)) / np.maximum(a, 1e-300)
    depth = np.where((depth > 0) & (depth < max_depth), depth, np.nan)
    return strip.to_plane(camera.center_world + depth[:, None] * rays)


def sigma_depth_on(strip: StripFrame, camera: Camera, points_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) σ of the depth, and the depth, at which a cylinder is seen at (N, 2) pixels; NaN where it is not."""
    at = unproject_onto(points_px, strip, camera)
    points = strip.to_world(at)
    normals = np.cross(*np.moveaxis(strip.by_uv(at), 1, 0))
    _, depth = camera.project(points)
    facing = np.abs(np.sum(camera.rays_world(points_px) * normals, axis=1)) / np.linalg.norm(normals, axis=1)
    return strip.cylinder.sigma_offset(points) / np.maximum(facing, 1e-12), depth


def strip_of(extent: Extent) -> StripFrame | None:
    """The strip that an extent lies on; None for one on a plane."""
    return extent.frame if isinstance(extent.frame, StripFrame) else None


def bordered(region: MultiPolygon, frame: StripFrame) -> MultiPolygon:
    """The same region with a corner wherever its outline crosses the border of a facet."""
    return MultiPolygon(
        [
            Polygon(*[_crossed(ring, frame) for ring in (part.exterior,)], [_crossed(r, frame) for r in part.interiors])
            for part in region.geoms
        ]
    )


def _crossed(ring: shapely.LinearRing, frame: StripFrame) -> FloatArray:
    points = shapely.get_coordinates(ring)
    out = [points[:1]]
    for start, end in pairwise(points):
        inner = frame.borders(*sorted((start[0], end[0])))
        if len(inner):
            inner = inner if start[0] < end[0] else inner[::-1]
            share = ((inner - start[0]) / (end[0] - start[0]))[:, None]
            between = start + share * (end - start)
            between[:, 0] = inner
            out.append(between)
        out.append(end[None])
    return np.concatenate(out)


def pieces(region: MultiPolygon, frame: PlaneFrame) -> list[MultiPolygon]:
    """A region as it is triangulated: on a strip facet by facet, from the first along it; on a plane the whole."""
    if not isinstance(frame, StripFrame) or region.is_empty:
        return [region]
    region = bordered(region, frame)
    low, bottom, high, top = region.bounds
    ends = [low, *frame.borders(low, high).tolist(), high]
    cut = [polygons(region.intersection(box(start, bottom - 1.0, end, top + 1.0))) for start, end in pairwise(ends)]
    return [piece for piece in cut if not piece.is_empty]


def flat_parts(plane: Plane, extent: Extent) -> Sequence[tuple[Plane, Extent]]:
    """A surface as planes: itself, or the facets of a curved one, each with its extent."""
    strip = strip_of(extent)
    if strip is None:
        return ((plane, extent),)
    return [_facet(plane, piece, strip) for piece in pieces(extent.region, strip)]


def _facet(plane: Plane, piece: MultiPolygon, strip: StripFrame) -> tuple[Plane, Extent]:
    low, _, high, _ = piece.bounds
    start, end = strip.to_world(np.array([[low, 0.0], [high, 0.0]]))
    up = strip.by_uv(np.zeros((1, 2)))[0, 1]
    normal = np.cross(end - start, up)
    normal /= np.linalg.norm(normal)
    along = (end - start) / np.linalg.norm(end - start)
    frame = PlaneFrame(start, np.stack([along, np.cross(normal, along)]))
    region = polygons(shapely.transform(piece, lambda uv: frame.to_plane(strip.to_world(uv))))
    return replace(plane, normal=normal, d=-float(normal @ start)), Extent(frame, region, region)


def on_surface(geometry: BaseGeometry, frame: PlaneFrame) -> FloatArray:
    """(N, 3) world points of the corners of a geometry in a frame."""
    return frame.to_world(shapely.get_coordinates(geometry))


def sigma_along_normal(plane: Plane, extent: Extent, points_world: FloatArray) -> FloatArray:
    """(N,) σ of a surface's position along its normal at (N, 3) points on it, world unit."""
    strip = strip_of(extent)
    return plane.sigma_offset(points_world) if strip is None else strip.cylinder.sigma_offset(points_world)
