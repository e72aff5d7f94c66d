"""Stage 5: the finite part of its plane that each element covers (paper 3.4)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.config import ExtentConfig
from gtlayout.edges import ContactEdge
from gtlayout.geometry.plane_image import clip_to_plane, inverse_depth, median_depth, unproject
from gtlayout.geometry.polygons import flat, grid_for, half_plane, homogeneous, polygons
from gtlayout.instances import Extent, Instance, Plane, PlaneFrame
from gtlayout.known_part import known_part
from gtlayout.scene import Camera, FloatArray, IntArray, Scene

_GRID_PX = 1e-9
_GAP_STEPS = 4.0
"""Samples of a contact edge further apart than so many usual steps have something hidden between them."""
_CONTACT_PX = 0.1
"""A contact edge's line is kept to this."""
_ON_LINE_STEPS = 10.0
"""A region that ends on a line, to the grid's precision, may reach beyond it by less than so many of its steps."""
_STRAIGHT_STEPS = 1e3
"""A corner so near to the line through its neighbours (some micrometres in a room) is none."""


def compute_extents(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    edges: Sequence[ContactEdge],
    config: ExtentConfig,
) -> tuple[Extent, ...]:
    """Each instance's extent: the union of its unprojected polygons, refined to the planes it touches.

    A host (wall) covers the masks of its doors and windows too; these keep an extent of their own. Unobservable
    planes get empty regions. An extent ends where the depth is unknown.
    """
    depth = median_depth(scene, instances, planes)
    max_depth, grid = config.max_depth_ratio * depth, grid_for(depth)
    frames = [_plane_frame(plane, scene) for plane in planes]
    drawn = [
        _tidy(_consensus(scene, instances, i, planes, frames[i], max_depth, grid, config), grid, config)
        if planes[i].observable
        else MultiPolygon()
        for i in range(len(instances))
    ]
    unrefined = [
        _ended(region, plane, frame, [scene.frame_of(k).camera for k, _ in instance.members], grid, config)
        for region, plane, frame, instance in zip(drawn, planes, frames, instances, strict=True)
    ]
    touching = _unproject_edges(scene, instances, planes, frames, edges, max_depth, config)
    regions = [
        _tidy(
            _refine(
                region, frames[i], [(planes[j], line) for (k, j), line in touching.items() if k == i], grid, config
            ),
            grid,
            config,
        )
        for i, region in enumerate(unrefined)
    ]
    unknown = [max(all_of_it.area - rest.area, 0.0) for all_of_it, rest in zip(drawn, unrefined, strict=True)]
    return tuple(Extent(*parts) for parts in zip(frames, regions, unrefined, unknown, strict=True))


def _ended(
    region: MultiPolygon, plane: Plane, frame: PlaneFrame, cameras: Sequence[Camera], grid: float, config: ExtentConfig
) -> MultiPolygon:
    """The region without what may be anywhere; ``cameras`` are those it was drawn in."""
    known = known_part(region, plane, frame, cameras, config)
    return region if known is region else _tidy(known, grid, config)


def _plane_frame(plane: Plane, scene: Scene) -> PlaneFrame:
    """A frame whose origin lies opposite the cameras' mean position, so that coordinates stay small."""
    centre = np.mean([frame.camera.center_world for frame in scene.frames], axis=0)
    origin = centre - (plane.normal @ centre + plane.d) * plane.normal
    return PlaneFrame.across(plane.normal, origin)


def _consensus(
    scene: Scene,
    instances: Sequence[Instance],
    index: int,
    planes: Sequence[Plane],
    frame: PlaneFrame,
    max_depth: float,
    grid: float,
    config: ExtentConfig,
) -> BaseGeometry:
    """What most key frames say an instance covers, in its plane's frame.

    The paper takes the union of the polygons of all key frames: every slip of a hand or a camera then adds to it. Here
    all polygons' boundaries cut the plane into faces, and a face belongs to the instance unless more key frames see
    something else there, on or behind the plane, than see the instance. Something in front may hide it: no vote.
    """
    plane, host = planes[index], instances[index].host
    own = {member for i, one in enumerate(instances) if index in (i, one.host) for member in one.members}
    instance_of = {member: i for i, one in enumerate(instances) for member in one.members}
    seen, contradicted = [], []
    for k, key_frame in enumerate(scene.key_frames):
        camera = scene.frame_of(k).camera
        mine = shapely.union_all([element.amodal for e, element in enumerate(key_frame.elements) if (k, e) in own])
        seen.append(_lift(mine, plane, camera, frame, max_depth, config))
        for e, element in enumerate(key_frame.elements):
            other = instance_of.get((k, e))
            if other is None or (k, e) in own or not (planes[other].observable or other == host):
                continue
            # On a fine grid, and repaired: neighbours drawn with the same corners leave needles that GEOS trips over.
            region = polygons(shapely.difference(element.amodal, mine, grid_size=_GRID_PX))
            if other != host and not region.is_empty:
                not_nearer = inverse_depth(plane, camera) / (1 - config.occluder_margin) - inverse_depth(
                    planes[other], camera
                )
                region = region.intersection(half_plane(not_nearer, region))
            contradicted.append(_lift(region, plane, camera, frame, max_depth, config))
    if all(region.is_empty for region in seen):
        return MultiPolygon()
    # Two frames' boundaries may run on top of each other: on a grid they cross cleanly, and no face is lost.
    lines = shapely.union_all([region.boundary for region in seen + contradicted], grid_size=grid)
    faces = shapely.get_parts(shapely.polygonize([lines]))
    inside = shapely.get_coordinates(shapely.point_on_surface(faces))
    votes = _count(seen, inside)
    return shapely.union_all(faces[(votes > 0) & (votes >= _count(contradicted, inside))], grid_size=grid)


def _lift(
    region_px: BaseGeometry, plane: Plane, camera: Camera, frame: PlaneFrame, max_depth: float, config: ExtentConfig
) -> MultiPolygon:
    """An image region on the plane, in its frame."""
    clipped = clip_to_plane(region_px, plane, camera, max_depth, config.min_horizon_px)
    return polygons(shapely.transform(clipped, lambda px: frame.to_plane(unproject(px, plane, camera))))


def _count(regions: Sequence[MultiPolygon], points: FloatArray) -> IntArray:
    """(N,) in how many of the regions each point lies."""
    count = np.zeros(len(points), dtype=np.int64)
    for region in regions:
        count += shapely.contains_xy(region, points)
    return count


def _straight(geometry: BaseGeometry, grid: float) -> MultiPolygon:
    """The polygonal part of a geometry without corners on straight lines, its corners in an order of their own.

    Overlays leave such corners by chance; whatever goes on from here has the same to go on with.
    """
    return polygons(shapely.normalize(shapely.simplify(polygons(geometry), _STRAIGHT_STEPS * grid)))


def _tidy(geometry: BaseGeometry, grid: float, config: ExtentConfig) -> MultiPolygon:
    """Without the tiny pieces and holes that hand-drawn neighbours leave."""
    parts = _straight(geometry, grid)
    least = config.min_piece * parts.area
    return MultiPolygon(
        [
            Polygon(part.exterior, [hole for hole in part.interiors if Polygon(hole).area >= least])
            for part in parts.geoms
            if part.area >= least
        ]
    )


def _unproject_edges(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    frames: Sequence[PlaneFrame],
    edges: Sequence[ContactEdge],
    max_depth: float,
    config: ExtentConfig,
) -> dict[tuple[int, int], BaseGeometry]:
    """The contact edges in i's frame for each ordered pair (i, j) that touches. A door's count for its host as well."""
    lines: dict[tuple[int, int], list[BaseGeometry]] = {}
    for edge in edges:
        camera = scene.frame_of(edge.key_frame).camera
        for first, second in (edge.instances, edge.instances[::-1]):
            plane, host_of_second = planes[first], instances[second].host
            other = second if host_of_second is None else host_of_second
            drawn = _runs(edge.points_px)
            clipped = clip_to_plane(drawn, plane, camera, max_depth, config.min_horizon_px)
            if clipped.is_empty or not (plane.observable and planes[other].observable):
                continue
            line = shapely.transform(clipped, lambda px: frames[first].to_plane(unproject(px, plane, camera)))  # noqa: B023
            for mine in {first, instances[first].host}:
                if mine is not None and mine != other:
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


def _refine(
    region: MultiPolygon,
    frame: PlaneFrame,
    neighbours: Iterable[tuple[Plane, BaseGeometry]],
    grid: float,
    config: ExtentConfig,
) -> MultiPolygon:
    """Both 10 % rules: first extend towards every neighbour, then cut what pokes through."""
    area = region.area
    if area == 0:
        return region
    touching = []
    for plane, contact in neighbours:
        # The neighbour's plane in this frame is a u + b v + c: a distance once divided by |(a, b)| = sin(angle).
        line = np.append(frame.axes @ plane.normal, plane.normal @ frame.origin + plane.d)
        sine = float(np.hypot(line[0], line[1]))
        if sine < np.sin(np.deg2rad(config.min_angle_deg)):
            continue
        line /= sine
        touching.append((_towards(region, line, contact), contact))
    for line, contact in touching:
        gap = _gap(region, line, contact)
        if gap.area <= config.max_growth * area:
            region = _straight(shapely.union(region, gap, grid_size=grid), grid)
    for line, contact in touching:
        beyond = _beyond(region, line, contact, _ON_LINE_STEPS * grid)
        if beyond.area <= config.max_cut * area:
            region = _straight(shapely.difference(region, beyond, grid_size=grid), grid)
    return region


def _towards(region: MultiPolygon, line: FloatArray, contact: BaseGeometry) -> FloatArray:
    """The line's coefficients with the sign that is positive where the region meets the contact.

    Not where most of the region lies: the floor goes on past the end of a pillar or cabinet that juts into the room.
    """
    distance = homogeneous(shapely.get_coordinates(contact)) @ line
    # Through the contact as drawn, which borders the region even where the planes' own intersection is off.
    drawn = line - [0.0, 0.0, float(np.median(distance))]
    width = max(float(np.ptp(distance)), max(part.length for part in shapely.get_parts(contact)) / 4)
    beside = region.intersection(contact.buffer(width, cap_style="flat"))
    positive = beside.intersection(half_plane(drawn, shapely.union_all([region, contact])))
    return line if positive.area >= beside.area / 2 else -line


def _reach(line: FloatArray, contact: BaseGeometry) -> float:
    """How far from the intersection line an element's drawn boundary may lie: twice the contact's distance."""
    return 2 * float(np.abs(homogeneous(shapely.get_coordinates(contact)) @ line).max())


def _gap(region: MultiPolygon, line: FloatArray, contact: BaseGeometry) -> MultiPolygon:
    """What lies between the intersection line and the region's boundary along the contact: its shadow on the line.

    ``line`` (a, b, c) gives the distance to the line, positive on the region's side.
    """
    reach = _reach(line, contact)
    boundary = region.boundary.intersection(contact.buffer(reach)).intersection(half_plane(line, region))
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
