"""The body of a curved wall, away from the room: an arc that is swept upwards, or slabs where openings are cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.export.solid import Solid
from gtlayout.geometry.strip import StripFrame, pieces
from gtlayout.instances import PlaneFrame
from gtlayout.scene import FloatArray

_WHOLE_SHARE = 0.97
"""A region that covers so much of its rectangle is one."""


@dataclass(frozen=True)
class ArcBody:
    """A ring's sector, swept along its axis."""

    frame: PlaneFrame
    """Level, about the axis, at the foot of the wall; its normal is up."""
    inner: float
    outer: float
    """Radii, world unit; that towards the room is measured."""
    measured: float
    """Which of them is."""
    from_rad: float
    to_rad: float
    """Counter-clockwise from the frame's first axis, the second larger."""
    height: float
    """World unit."""


def arc_body(region: MultiPolygon, strip: StripFrame, thickness: float) -> ArcBody | None:
    """The body of a wall that is a whole rectangle of its strip; None of one with gaps, openings or a slanted top."""
    if len(region.geoms) != 1 or region.area < _WHOLE_SHARE * shapely.box(*region.bounds).area:
        return None
    if any(Polygon(hole).area > (1 - _WHOLE_SHARE) * region.area for hole in region.geoms[0].interiors):
        return None
    cylinder, (_, low, _, high) = strip.cylinder, region.bounds
    up = cylinder.axis_world
    first = cylinder.axes[0] - (cylinder.axes[0] @ up) * up
    first /= np.linalg.norm(first)
    # Heights of the strip are along its own axis upwards, and the lean is small.
    foot = cylinder.axis_point_world + low / float(up @ cylinder.axes[2]) * up
    radii = sorted((cylinder.radius, _behind(strip, thickness)))
    return ArcBody(
        PlaneFrame(foot, np.stack([first, np.cross(up, first)])),
        radii[0],
        radii[1],
        cylinder.radius,
        *strip.arc_rad(region),
        high - low,
    )


def slabs(region: MultiPolygon, strip: StripFrame, thickness: float) -> tuple[Solid, ...]:
    """The body facet by facet, in the plane that touches the strip: (u, v, along the normal there)."""
    return tuple(
        _slab(shapely.orient_polygons(polygon), strip, thickness)
        for piece in pieces(region, strip)
        for polygon in piece.geoms
    )


def _behind(strip: StripFrame, thickness: float) -> float:
    """The radius of the side that nobody saw; a column has a core, however thick its wall is said to be."""
    radius = strip.cylinder.radius
    return radius + thickness if strip.concave else max(radius - thickness, radius / 2)


def _slab(polygon: Polygon, strip: StripFrame, thickness: float) -> Solid:
    rings = [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    uv = np.concatenate(rings)
    count, number = len(uv), {tuple(point): i for i, point in enumerate(uv.tolist())}
    faces: list[tuple[int, ...]] = []
    for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(polygon)):
        corners = [
            number[tuple(point)] for point in shapely.get_coordinates(shapely.orient_polygons(triangle))[:3].tolist()
        ]
        faces += [tuple(corners), tuple(count + i for i in reversed(corners))]
    start = 0
    for ring in rings:
        for k in range(len(ring)):
            a, b = start + k, start + (k + 1) % len(ring)
            faces += [(a, count + a, count + b), (a, count + b, b)]
        start += len(ring)
    world = np.concatenate([strip.to_world(uv), _moved(strip, uv, _behind(strip, thickness))])
    to_frame = np.stack([*strip.axes, np.cross(*strip.axes)])
    return Solid((world - strip.origin) @ to_frame.T, tuple((face,) for face in faces))


def _moved(strip: StripFrame, uv: FloatArray, radius: float) -> FloatArray:
    """(N, 3) the same places on a cylinder about the same axis with another radius."""
    on = strip.to_world(uv)
    cylinder = strip.cylinder
    heights = uv[:, 1:]
    axis = cylinder.origin + (cylinder.values[:2] + heights * cylinder.values[3:]) @ cylinder.axes[:2]
    axis = axis + heights * cylinder.axes[2]
    return axis + radius / cylinder.radius * (on - axis)
