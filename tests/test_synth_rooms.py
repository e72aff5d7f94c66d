"""Synthetic rooms of every kind: closed, furnished, drawn as they look, and true."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import combinations, pairwise

import cv2
import numpy as np
import pytest
import shapely
from shapely import MultiLineString, MultiPoint, Point, Polygon

from gtlayout.raster import fill, rings_of
from gtlayout.scene import OPENINGS, Camera, FloatArray, IntArray, KeyFrame
from gtlayout.synth_annotate import annotate, draw, occlusion_edges
from gtlayout.synth_extents import seen_extents
from gtlayout.synth_furniture import LOW_M, furnish
from gtlayout.synth_plans import SKEW_DEG, Plan, l_shaped, polygon, slanted, two_rooms
from gtlayout.synth_render import cast
from gtlayout.synth_room import CLEARANCE_M, ROOM_KINDS, Room, RoomKind, make_room
from gtlayout.synth_surfaces import Surface, make_surface
from gtlayout.synth_textures import plain

SEED = 1
WIDTH, HEIGHT = 200, 150
PLANS = (l_shaped, polygon, slanted, two_rooms)
Drawn = tuple[KeyFrame, dict[str, str]]

every_kind = pytest.mark.parametrize("kind", ROOM_KINDS)
every_plan = pytest.mark.parametrize("make", PLANS)


@cache
def the_room(kind: RoomKind) -> Room:
    return make_room(SEED, kind)


@cache
def views(kind: RoomKind) -> tuple[Camera, ...]:
    """From where one may stand in the near half, towards what is worth seeing."""
    room, rng = the_room(kind), np.random.default_rng(SEED)
    low, high = np.reshape(room.standing.bounds, (2, 2))
    found: list[Camera] = []
    while len(found) < 6:
        centre = np.append(rng.uniform(low, high), 1.5)
        ahead = np.append(room.focus, 1.3) + rng.normal(0, 0.3, 3) - centre
        if room.standing.contains(Point(centre)) and ahead[1] > 0 and np.linalg.norm(ahead[:2]) > 0.8:
            found.append(_camera(centre, ahead))
    return tuple(found)


@cache
def drawn(kind: RoomKind) -> tuple[Drawn, ...]:
    room = the_room(kind)
    return tuple(annotate(room, c, cast(room.surfaces, c), 0, np.random.default_rng(0)) for c in views(kind))


def _camera(centre: FloatArray, ahead: FloatArray) -> Camera:
    forward = ahead / np.linalg.norm(ahead)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    R_cam_from_world = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[130.0, 0, WIDTH / 2], [0, 130, HEIGHT / 2], [0, 0, 1]])
    return Camera(K, R_cam_from_world, -R_cam_from_world @ centre, WIDTH, HEIGHT)


def _plans(make: object) -> list[Plan]:
    assert callable(make)
    return [make(np.random.default_rng([seed, 0])) for seed in range(20)]


def _depth(surface: Surface, camera: Camera, points_px: FloatArray) -> FloatArray:
    return -(surface.normal @ camera.center_world + surface.d) / (camera.rays_world(points_px) @ surface.normal)


def _solid_angle(corners: FloatArray, eye: FloatArray) -> float:
    """Of a polygon, negative where its corners run clockwise seen from the eye."""
    rays = corners - eye
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    total = 0.0
    a = rays[0]
    for b, c in pairwise(rays[1:]):
        total += 2 * np.arctan2(a @ np.cross(b, c), 1 + a @ b + b @ c + c @ a)
    return -total


@every_plan
def test_the_building_is_closed_planar_and_faces_inwards(make: object) -> None:
    """The signed solid angle of a closed surface is 4π from every point inside it, and from none else."""
    for plan in _plans(make):
        shell = [panel.corners_world for panel in plan.panels if panel.label not in OPENINGS]
        for eye in ([*plan.focus, 1.5], [*shapely.get_coordinates(plan.upright.representative_point())[0], 0.4]):
            assert sum(_solid_angle(corners, np.array(eye)) for corners in shell) == pytest.approx(4 * np.pi)
        for panel in plan.panels:
            off = (panel.corners_world - panel.corners_world[0]) @ panel.normal
            np.testing.assert_allclose(off, 0, atol=1e-12)
            uv = Polygon(panel.frame.to_plane(panel.corners_world))
            assert uv.is_valid
            assert uv.exterior.is_ccw
            assert abs(np.diff(panel.corners_world[:2, 2])[0]) < 1e-12


@every_plan
def test_openings_lie_in_their_wall_and_nothing_else(make: object) -> None:
    for plan in _plans(make):
        taken: dict[str, list[Polygon]] = {}
        for panel in plan.panels:
            if panel.label in OPENINGS:
                hosts = [
                    wall
                    for wall in plan.panels
                    if wall.label in ("wall", "slanted")
                    and np.abs((panel.corners_world - wall.corners_world[0]) @ wall.normal).max() < 1e-9
                    and Polygon(wall.frame.to_plane(wall.corners_world))
                    .buffer(1e-9)
                    .covers(Polygon(wall.frame.to_plane(panel.corners_world)))
                ]
                assert len(hosts) == 1
                place = Polygon(hosts[0].frame.to_plane(panel.corners_world))
                assert not any(place.intersects(other) for other in taken.get(hosts[0].name, []))
                taken.setdefault(hosts[0].name, []).append(place)


@every_plan
def test_furniture_stays_in_its_room_and_apart(make: object) -> None:
    for seed, plan in enumerate(_plans(make)):
        boxes = furnish(plan, np.random.default_rng(seed))
        footprints = [Polygon(box.faces()[4][:, :2]) for box in boxes]
        floors = [plan.floor(room) for room in range(len(plan.lamps_world))]
        assert len(boxes) >= 4
        for box, footprint in zip(boxes, footprints, strict=True):
            assert any(floor.covers(footprint) for floor in floors)
            top = box.centre[2] + box.size[2] / 2
            if top > LOW_M and floors[0].covers(footprint):
                assert plan.upright.covers(footprint)
                assert footprint.disjoint(plan.low_only)
            assert footprint.disjoint(plan.clear) or top < 0.7  # a table's top reaches beyond its legs
        for (first, a), (second, b) in combinations(zip(boxes, footprints, strict=True), 2):
            overlap_m = min(one.centre[2] + one.size[2] / 2 for one in (first, second)) - max(
                one.centre[2] - one.size[2] / 2 for one in (first, second)
            )
            assert a.buffer(-1e-6).disjoint(b) or overlap_m < 1e-9


def test_walls_of_a_skew_room_are_neither_parallel_nor_square() -> None:
    dented = 0
    for plan in _plans(polygon):
        normals = np.array([panel.normal for panel in plan.panels if panel.label == "wall"])
        assert len(normals) in (5, 6)
        angle_deg = np.rad2deg(np.arccos(np.clip(normals @ normals.T, -1, 1)))[np.triu_indices(len(normals), 1)]
        assert np.abs((angle_deg + 45) % 90 - 45).min() > SKEW_DEG - 1e-6
        dented += plan.upright.convex_hull.area > 1.02 * plan.upright.area
    assert 0 < dented < 20


@every_kind
def test_surfaces_have_the_labels_of_their_kind(kind: RoomKind) -> None:
    labels = [surface.label for surface in the_room(kind).structure]
    assert set(labels) == {"floor", "ceiling", "wall", "door", "window"} | ({"slanted"} if kind == "slanted" else set())
    floors = {"two-rooms": 2}.get(kind, 1)
    assert (labels.count("floor"), labels.count("ceiling")) == (floors, floors)
    walls = {"l-shaped": [6], "two-rooms": [8], "polygon": [5, 6]}.get(kind, [4])
    assert labels.count("wall") in walls
    names = [surface.name for surface in the_room(kind).structure]
    assert len(set(names)) == len(names)


@every_kind
def test_normals_point_into_the_room(kind: RoomKind) -> None:
    room = the_room(kind)
    floors = shapely.union_all([Polygon(s.corners_world[:, :2]) for s in room.structure if s.label == "floor"])
    above = [s for s in room.structure if s.label == "slanted" or s.name == "ceiling"]
    for surface in room.building:
        uv = shapely.get_coordinates(Polygon(surface.corners_uv).representative_point())
        point = surface.frame.to_world(uv)[0] + 0.01 * surface.normal
        assert floors.contains(Point(point))
        assert point[2] > 0
        if kind != "two-rooms":
            assert all(other.normal @ point + other.d > 0 for other in above)


@every_kind
def test_a_camera_may_stand_inside_away_from_walls_and_furniture(kind: RoomKind) -> None:
    room = the_room(kind)
    floor = next(Polygon(s.corners_world[:, :2]) for s in room.structure if s.label == "floor")
    assert room.standing.is_valid
    assert room.standing.area > 3
    assert floor.contains(room.standing)
    assert room.standing.distance(floor.exterior) > CLEARANCE_M - 1e-9
    assert floor.contains(Point(room.focus))
    for surface in room.furniture:
        if surface.normal[2] > 0.5 and surface.corners_world[0, 2] > LOW_M:
            assert room.standing.distance(Polygon(surface.corners_world[:, :2])) > CLEARANCE_M - 1e-9
    corners = np.array(room.standing.exterior.coords)
    for surface in room.structure:
        if surface.label == "slanted" or surface.name == "ceiling":
            above_m = -(corners @ surface.normal[:2] + surface.d) / surface.normal[2]
            assert above_m.min() > room.height_m - 1e-9


@every_kind
def test_every_ray_meets_something_and_furniture_hides_floor_and_walls(kind: RoomKind) -> None:
    room, hidden = the_room(kind), {"floor": 0, "wall": 0}
    for camera in views(kind):
        hits, behind = cast(room.surfaces, camera), cast(room.building, camera)
        assert (hits.surface >= 0).all()
        assert (behind.surface >= 0).all()
        assert (hits.depth <= behind.depth + 1e-9).all()
        by_furniture = behind.surface[hits.surface >= room.built]
        for number in np.unique(by_furniture):
            label = room.surfaces[number].label
            if label in hidden:
                hidden[label] += int((by_furniture == number).sum())
    assert min(hidden.values()) > 0.01 * len(views(kind)) * WIDTH * HEIGHT


@every_kind
def test_what_is_drawn_is_what_the_empty_room_looks_like(kind: RoomKind) -> None:
    room = the_room(kind)
    index = {surface.name: number for number, surface in enumerate(room.surfaces[: room.built])}
    for camera, (key_frame, names) in zip(views(kind), drawn(kind), strict=True):
        seen = cast(room.building, camera).surface
        labels = np.full(seen.shape, -1)
        for element in sorted(key_frame.elements, key=lambda e: e.label in OPENINGS):
            assert element.amodal.is_valid
            labels[fill(rings_of(element.amodal), HEIGHT, WIDTH)] = index[names[element.id]]
        # Away from the boundaries, where a pixel's centre decides.
        reach = np.ones((3, 3), np.uint8)
        inner = cv2.erode(seen.astype(np.int16), reach) == cv2.dilate(seen.astype(np.int16), reach)
        labelled = np.array([surface.label is not None for surface in room.building])[seen]
        assert (labels == seen)[inner & (labels >= 0)].all()
        assert (inner & (labels < 0) & labelled).mean() < 0.01  # pieces too small to draw
        assert len(key_frame.elements) >= 3


@every_kind
def test_visible_parts_are_within_their_element_and_really_seen(kind: RoomKind) -> None:
    room, share = the_room(kind), 0.0
    for camera, (key_frame, names) in zip(views(kind), drawn(kind), strict=True):
        hits = cast(room.surfaces, camera)
        for element in key_frame.elements:
            assert (element.visible - element.amodal).area < 1e-6
            mask = fill(rings_of(element.visible), HEIGHT, WIDTH)
            assert {room.surfaces[n].name for n in np.unique(hits.surface[mask])} <= {names[element.id]}
            share += float(mask.mean()) / len(views(kind))
    assert share > 0.3


@pytest.mark.parametrize(("strip_px", "is_drawn"), [(2.5, False), (9.0, True)])
def test_a_sliver_of_a_window_at_the_image_border_is_left_to_its_wall(strip_px: float, is_drawn: bool) -> None:
    room = the_room("box")
    window = next(surface for surface in room.structure if surface.label == "window")
    camera = _camera(np.append(room.focus - (0.3, 1.0), 1.5), np.array([0.1, 1.0, 0.0]))
    left_px = camera.project(window.corners_world)[0][:, 0].min()
    shift = np.array([[0, 0, WIDTH - strip_px - left_px], [0, 0, 0], [0, 0, 0]])
    shifted = replace(camera, K=camera.K + shift)
    key_frame, _ = annotate(room, shifted, cast(room.surfaces, shifted), 0, np.random.default_rng(0))
    labels = [element.label for element in key_frame.elements]
    assert ("window" in labels) == is_drawn
    assert sum(element.amodal.area for element in key_frame.elements if element.label not in OPENINGS) == pytest.approx(
        WIDTH * HEIGHT
    )


@every_kind
def test_neighbours_share_every_corner_on_their_common_boundary(kind: RoomKind) -> None:
    shared = 0
    for key_frame, _ in drawn(kind):
        for one in key_frame.elements:
            corners = shapely.points(np.concatenate(rings_of(one.amodal)))
            for other in key_frame.elements:
                if other is not one:
                    on_it = corners[shapely.distance(other.amodal.boundary, corners) < 0.02]
                    theirs = MultiPoint(np.concatenate(rings_of(other.amodal)))
                    assert (shapely.distance(theirs, on_it) == 0).all()
                    shared += len(on_it)
        for line in key_frame.occlusion_edges:
            corners = np.concatenate([ring for e in key_frame.elements for ring in rings_of(e.amodal)])
            apart = np.linalg.norm(line[:, None] - corners, axis=2).min(axis=1)
            assert apart[np.r_[0, -1]].max() == 0 or kind == "two-rooms"  # there it may end on an unlabelled reveal
    assert shared > 50


@every_kind
def test_occlusion_edges_run_exactly_where_the_buildings_depth_jumps(kind: RoomKind) -> None:
    room, jumps = the_room(kind), 0
    for camera, (key_frame, _) in zip(views(kind), drawn(kind), strict=True):
        lines = MultiLineString(list(key_frame.occlusion_edges))
        seen = cast(room.building, camera).surface
        between, least_m, most_m = _gaps(room, camera, seen)
        assert (shapely.distance(lines, shapely.points(between)) < 1.5)[least_m > 0.1].all()
        jumps += int((least_m > 0.1).sum())
        along = shapely.line_interpolate_point(lines, np.arange(0.5, lines.length, 1.0)) if not lines.is_empty else []
        for point in shapely.get_coordinates(along):
            if 3 < point[0] < WIDTH - 3 and 3 < point[1] < HEIGHT - 3:
                assert most_m[np.linalg.norm(between - point, axis=1) < 2].max() > 0.01
    assert (jumps > 100) == (kind in ("l-shaped", "two-rooms")) or kind == "polygon"


def _gaps(room: Room, camera: Camera, seen: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(N, 2) px between pixels that show two surfaces, and how far these are apart there, m.

    The least and the most within three quarters of a pixel: at a grazing angle that may be decimetres.
    """
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    points, pairs = [], []
    for axis, step in ((0, (0.5, 1.0)), (1, (1.0, 0.5))):
        a, b = (np.delete(seen, cut, axis) for cut in (-1, 0))
        at = a != b
        points.append(np.stack([np.delete(grid, -1, axis)[at] for grid in (x, y)], axis=1) + step)
        pairs.append(np.stack([a[at], b[at]], axis=1))
    between, pair = np.concatenate(points), np.concatenate(pairs)
    gap = np.zeros((9, len(between)))
    for one, other in np.unique(pair, axis=0):
        at = (pair == (one, other)).all(axis=1)
        for number, shift in enumerate(np.mgrid[-1:2, -1:2].reshape(2, 9).T * 0.75):
            depths = [_depth(room.building[k], camera, between[at] + shift) for k in (one, other)]
            gap[number, at] = depths[0] - depths[1]
    crossing = (gap.min(axis=0) < 0) & (gap.max(axis=0) > 0)
    return between, np.where(crossing, 0, np.abs(gap).min(axis=0)), np.abs(gap).max(axis=0)


def _flat(name: str, left: float, right: float, depth: float, low: float = -2.0, high: float = 2.0) -> Surface:
    """A wall across the view of a camera at the origin that looks along z."""
    corners = np.array([[left, high, depth], [right, high, depth], [right, low, depth], [left, low, depth]])
    return make_surface(
        name,
        "wall",
        corners,
        lambda rng, shape: plain(rng, shape, (90, 90, 90), 5),
        lambda points, _: np.ones(len(points)),
        np.random.default_rng(0),
    )


def test_a_pillar_cuts_the_wall_behind_it_in_two() -> None:
    camera = Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), np.eye(3), np.zeros(3), 100, 80)
    wall, pillar = _flat("wall", -3, 3, 4.0, -3, 3), _flat("pillar", -0.2, 0.2, 2.0)
    drawing = draw((wall, pillar), camera)
    left, right = sorted(drawing.regions[0].geoms, key=lambda part: part.bounds)
    assert left.bounds == pytest.approx((0, 0, 40, 80), abs=1e-4)
    assert right.bounds == pytest.approx((60, 0, 100, 80), abs=1e-4)
    assert drawing.regions[1].bounds == pytest.approx((40, 0, 60, 80), abs=1e-4)
    lines = sorted(occlusion_edges(drawing, camera), key=lambda line: line[:, 0].min())
    for line, x in zip(lines, (40, 60), strict=True):
        np.testing.assert_allclose(line[:, 0], x, atol=1e-4)
        assert sorted(line[:, 1]) == pytest.approx([0, 80])


def test_walls_that_meet_share_an_edge_and_no_occlusion() -> None:
    camera = Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), np.eye(3), np.zeros(3), 100, 80)
    drawing = draw((_flat("left", -3, 0.1, 2.0), _flat("right", 0.1, 3, 2.004)), camera)
    assert occlusion_edges(drawing, camera) == ()
    drawing = draw((_flat("left", -3, 0.1, 2.0), _flat("right", 0.0, 3, 2.02)), camera)
    assert len(occlusion_edges(drawing, camera)) == 1


@every_kind
def test_the_extent_is_what_the_key_frames_show(kind: RoomKind) -> None:
    """Points of the empty room seen in a key frame lie in the extent, points of the extent are seen in one."""
    room = the_room(kind)
    extents = seen_extents(room, [(c, *each) for c, each in zip(views(kind), drawn(kind), strict=True)])
    assert set(extents) == {name for _, names in drawn(kind) for name in names.values()}
    regions = {
        name: shapely.union_all([Polygon(rings[0], rings[1:]) for rings in _in_plane(room, name, parts)])
        for name, parts in extents.items()
    }
    rng = np.random.default_rng(0)
    seen = dict.fromkeys(regions, 0)
    for number, surface in enumerate(room.building):
        if surface.name not in regions:
            continue
        own = [n for n, other in enumerate(room.building) if n == number or _in_wall(other, surface)]
        region, outline = regions[surface.name], Polygon(surface.corners_uv)
        assert outline.buffer(2e-4).covers(region)
        uv = rng.uniform(0, surface.corners_uv.max(axis=0), (400, 2))
        uv = uv[shapely.distance(outline.exterior, shapely.points(uv)) > 0.03]
        uv = uv[shapely.contains_xy(outline, uv)]
        visible = np.zeros(len(uv), bool)
        for camera in views(kind):
            if surface.normal @ camera.center_world + surface.d <= 0:
                continue
            px, depth = camera.project(surface.frame.to_world(uv))
            inside = (depth > 0) & ((px > 0) & (px < (WIDTH, HEIGHT))).all(axis=1)
            column, row = np.floor(px[inside]).astype(int).T
            visible[inside] |= np.isin(cast(room.building, camera).surface[row, column], own)
        away = shapely.distance(region.boundary, shapely.points(uv)) > 0.05
        agree = visible == shapely.contains_xy(region, uv)
        # Pieces too small to draw are seen, yet not part of it.
        assert agree[away].mean() > 0.97
        seen[surface.name] += int(visible.sum())
    assert sum(seen.values()) > 500


def _in_plane(room: Room, name: str, parts: list[list[FloatArray]]) -> list[list[FloatArray]]:
    surface = next(s for s in room.structure if s.name == name)
    for ring in (ring for rings in parts for ring in rings):
        np.testing.assert_allclose(ring @ surface.normal + surface.d, 0, atol=1e-9)
    return [[surface.frame.to_plane(ring) for ring in rings] for rings in parts]


def _in_wall(opening: Surface, wall: Surface) -> bool:
    off = np.abs(opening.corners_world @ wall.normal + wall.d).max()
    return opening.label in OPENINGS and wall.label not in OPENINGS and off < 1e-6


def test_the_same_seed_makes_the_same_room_and_another_seed_another() -> None:
    first, again, other = the_room("polygon"), make_room(SEED, "polygon"), make_room(SEED + 1, "polygon")
    for a, b in zip(first.surfaces, again.surfaces, strict=True):
        assert (a.name, a.label) == (b.name, b.label)
        np.testing.assert_array_equal(a.corners_world, b.corners_world)
        np.testing.assert_array_equal(a.mipmaps[0], b.mipmaps[0])
    assert first.standing.equals(again.standing)
    assert not np.allclose(other.surfaces[0].corners_world[:3], first.surfaces[0].corners_world[:3])


def test_the_box_room_is_what_it_always_was() -> None:
    """The door's size is drawn after all walls are painted: it tells whether the generator was used as before."""
    door = next(surface for surface in the_room("box").surfaces if surface.name == "door_0")
    expected = [[3.9062275561, 3.6772843346, 0], [3.9065043224, 2.7798144332, 2.0712296498]]
    np.testing.assert_allclose(door.corners_world[[0, 2]], expected, atol=1e-9)


def test_texture_scales_the_contrast_of_the_building_and_of_nothing_else() -> None:
    faint, blank = (make_room(SEED, "slanted", texture) for texture in (0.5, 0.0))
    for surfaces in zip(the_room("slanted").surfaces, faint.surfaces, blank.surfaces, strict=True):
        for surface in surfaces[1:]:
            np.testing.assert_array_equal(surface.corners_world, surfaces[0].corners_world)
        if surfaces[0].label is None or surfaces[0].label in OPENINGS:
            np.testing.assert_array_equal(surfaces[2].mipmaps[0], surfaces[0].mipmaps[0])
            continue
        contrast = [_contrast(surface) for surface in surfaces]
        assert contrast[0] > 3
        assert contrast[1] == pytest.approx(contrast[0] / 2, rel=0.25)
        assert 0.3 < contrast[2] < 2.0


def _contrast(surface: Surface) -> float:
    """σ of the texture finer than about 5 cm, grey levels: light and shade are coarser."""
    image = surface.mipmaps[0].astype(np.float32)
    fine = image - cv2.GaussianBlur(image, (0, 0), 8)
    width, height = (surface.corners_uv.max(axis=0) / 0.004).astype(int)
    return float(fine[:height, :width].std())
