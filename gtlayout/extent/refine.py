"""Extents grow up to their neighbours' planes, or are cut by them (paper 3.4)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.edges import ContactEdge
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.consensus import straight
from gtlayout.extent.on_cylinder import lift_line
from gtlayout.geometry.plane_image import clip_to_plane, unproject
from gtlayout.geometry.polygons import buffered, flat, half_plane, homogeneous, polygons
from gtlayout.geometry.strip import StripFrame
from gtlayout.instances import Instance, Plane, PlaneFrame
from gtlayout.scene import FloatArray, Scene

_GAP_STEPS = 4.0
"""Samples of a contact edge further apart than so many usual steps have something hidden between them."""
_CONTACT_PX = 0.1
"""A contact edge's line is kept to this."""
_ON_LINE_STEPS = 10.0
"""A region that ends on a line, to the grid's precision, may reach beyond it by less than so many of its steps."""


def unproject_edges(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    frames: Sequence[PlaneFrame],
    edges: Sequence[ContactEdge],
    max_depth: float,
    config: ExtentConfig,
    sought: Collection[int] | None = None,
) -> dict[tuple[int, int], BaseGeometry]:
    """The contact edges in i's frame for each ordered pair (i, j) that touches. A door's count for its host as well.

    Only for each i that is ``sought``, all when not given.
    """
    lines: dict[tuple[int, int], list[BaseGeometry]] = {}
    wanted = set(range(len(instances)) if sought is None else sought)
    for edge in edges:
        camera = scene.frame_of(edge.key_frame).camera
        for first, second in (edge.instances, edge.instances[::-1]):
            owners = {first, instances[first].host} & wanted
            if not owners:
                continue
            plane, host_of_second = planes[first], instances[second].host
            other = second if host_of_second is None else host_of_second
            drawn = _runs(edge.points_px)
            frame = frames[first]
            if isinstance(frame, StripFrame):
                if planes[other].observable and not (line := lift_line(drawn, frame, camera, max_depth)).is_empty:
                    lines.setdefault((first, other), []).append(line)
                continue
            clipped = clip_to_plane(drawn, plane, camera, max_depth, config.min_horizon_px)
            if clipped.is_empty or not (plane.observable and planes[other].observable):
                continue
            line = shapely.transform(clipped, lambda px: frames[first].to_plane(unproject(px, plane, camera)))  # noqa: B023
            for mine in owners:
                # A door's line is in its own plane, which is no place on a curved wall.
                if mine is not None and mine != other and not isinstance(frames[mine], StripFrame):
                    lines.setdefault((mine, other), []).append(line)
    return {pair: shapely.union_all(lines[pair]) for pair in sorted(lines)}


def _runs(points_px: FloatArray) -> BaseGeometry:
    """A contact edge as lines, broken where samples are missing, without corners that are only the hand's."""
    steps = np.linalg.norm(np.diff(points_px, axis=0), axis=1)
    if len(steps) == 0:
        return Polygon()
    runs = [
        run for run in np.split(points_px, np.nonzero(steps > _GAP_STEPS * np.median(steps))[0] + 1) if len(run) > 1
    ]
    return shapely.simplify(shapely.multilinestrings([shapely.linestrings(run) for run in runs]), _CONTACT_PX)


@dataclass(frozen=True)
class Neighbour:
    """What an extent touches."""

    plane: Plane
    contact: BaseGeometry
    """The contact edges in the extent's frame."""
    shift: float
    """How far from where the planes meet both end, towards the neighbour's front, world unit."""


def refine(
    region: MultiPolygon,
    frame: PlaneFrame,
    neighbours: Iterable[Neighbour],
    grid: float,
    config: ExtentConfig,
) -> MultiPolygon:
    """Both 10 % rules: first extend towards every neighbour, then cut what pokes through."""
    area = region.area
    if area == 0:
        return region
    touching = []
    for neighbour in neighbours:
        line, sine = (
            _line_on_strip(neighbour, frame) if isinstance(frame, StripFrame) else meeting_line(neighbour.plane, frame)
        )
        if sine < np.sin(np.deg2rad(config.min_angle_deg)):
            continue
        line[2] -= neighbour.shift
        touching.append((_towards(region, line, neighbour.contact, config.arc_segments), neighbour.contact))
    for line, contact in touching:
        gap = _gap(region, line, contact, config.arc_segments)
        if gap.area <= config.max_growth * area:
            region = straight(shapely.union(region, gap, grid_size=grid), grid)
    for line, contact in touching:
        beyond = _beyond(region, line, contact, _ON_LINE_STEPS * grid)
        if beyond.area <= config.max_cut * area:
            region = straight(shapely.difference(region, beyond, grid_size=grid), grid)
    return region


def meeting_line(neighbour: Plane, frame: PlaneFrame) -> tuple[FloatArray, float]:
    """(a, b, c) of the line in which two planes meet, and the sine of their angle.

    a u + b v + c is the distance from it in the frame of one, positive in front of the other.
    """
    line = np.append(frame.axes @ neighbour.normal, neighbour.normal @ frame.origin + neighbour.d)
    sine = float(np.hypot(line[0], line[1]))
    return line / max(sine, 1e-12), sine


def _line_on_strip(neighbour: Neighbour, strip: StripFrame) -> tuple[FloatArray, float]:
    """As ``meeting_line``, where the contact is: a plane that is neither level nor upright meets a strip in a curve."""
    at = strip.onto(neighbour.plane, np.median(shapely.get_coordinates(neighbour.contact), axis=0))
    gradient = strip.by_uv(at[None])[0] @ neighbour.plane.normal
    sine = float(np.linalg.norm(gradient))
    gradient = gradient / max(sine, 1e-12)
    return np.append(gradient, -float(gradient @ at)), sine


def _towards(region: MultiPolygon, line: FloatArray, contact: BaseGeometry, arc_segments: int) -> FloatArray:
    """The line's coefficients with the sign that is positive where the region meets the contact.

    Not where most of the region lies: the floor continues past the end of a pillar or cabinet that juts into the room.
    """
    distance = homogeneous(shapely.get_coordinates(contact)) @ line
    # Through the contact as drawn, which borders the region even where the planes' own intersection is off.
    drawn = line - [0.0, 0.0, float(np.median(distance))]
    width = max(float(np.ptp(distance)), max(part.length for part in shapely.get_parts(contact)) / 4)
    beside = region.intersection(buffered(contact, width, cap_style="flat", arc_segments=arc_segments))
    positive = beside.intersection(half_plane(drawn, shapely.union_all([region, contact])))
    return line if positive.area >= beside.area / 2 else -line


def _reach(line: FloatArray, contact: BaseGeometry) -> float:
    """How far from the intersection line an extent's boundary may lie: twice the contact's distance."""
    return 2 * float(np.abs(homogeneous(shapely.get_coordinates(contact)) @ line).max())


def _gap(region: MultiPolygon, line: FloatArray, contact: BaseGeometry, arc_segments: int) -> MultiPolygon:
    """What lies between the intersection line and the region's boundary along the contact: its shadow on the line.

    ``line`` (a, b, c) gives the distance to the line, positive on the region's side.
    """
    reach = _reach(line, contact)
    boundary = region.boundary.intersection(buffered(contact, reach, arc_segments=arc_segments)).intersection(
        half_plane(line, region)
    )
    quads = []
    for part in shapely.get_parts(flat(boundary)):
        points = shapely.get_coordinates(part)
        height = (homogeneous(points) @ line)[:, None]
        feet = points - height * line[:2]
        # A point on the line is its own foot: rounding must not put it beyond, where the quad would cross itself.
        points = feet + np.maximum(height, 0.0) * line[:2]
        quads += [Polygon([*points[k : k + 2], *feet[k : k + 2][::-1]]) for k in range(len(points) - 1)]
    return polygons(shapely.union_all([quad for quad in quads if quad.is_valid]))


def _beyond(region: MultiPolygon, line: FloatArray, contact: BaseGeometry, least: float) -> MultiPolygon:
    """What pokes through the neighbour's plane: the part beyond the intersection line, alongside the contact.

    A piece that lies mostly alongside goes whole, for a contact may be seen in part only. Of others, an alcove or the
    floor that goes on past the end of a pillar, only what is alongside goes.
    """
    along, across = np.array([-line[1], line[0]]), line[:2]
    depth = 2 * max(np.ptp(shapely.get_coordinates(region), axis=0))
    bands = []
    for part in shapely.get_parts(contact):
        points = shapely.get_coordinates(part)
        points = points - (homogeneous(points) @ line)[:, None] * across
        first, last = points[np.argmin(points @ along)], points[np.argmax(points @ along)]
        bands.append(Polygon([first, last, last - depth * across, first - depth * across]))
    alongside = shapely.union_all(bands)
    # Where the region ends on the line, rounding leaves threads beyond it, which must not tie pieces together.
    pieces = polygons(region.intersection(half_plane(-line - [0.0, 0.0, least], region)))
    parts = [(piece, polygons(piece.intersection(alongside))) for piece in pieces.geoms]
    cut = shapely.union_all([piece if part.area >= piece.area / 2 else part for piece, part in parts])
    # Back to the line itself, for which the pieces were looked at a little beyond it.
    beyond = polygons(region.intersection(half_plane(-line, region)))
    return polygons(beyond.intersection(cut.buffer(2 * least, join_style="mitre")))
