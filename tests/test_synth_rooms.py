"""Synthetic rooms of every kind: closed, furnished, with a place for cameras, blank when asked."""

from __future__ import annotations

from itertools import combinations, pairwise

import cv2
import numpy as np
import pytest
import shapely
from shapely import Point, Polygon
from synth_views import HEIGHT, SEED, WIDTH, every_kind, the_room, views

from gtlayout.scene import OPENINGS, FloatArray
from gtlayout.synth.curved_plans import bay, round_corner
from gtlayout.synth.furniture import LOW_M, furnish
from gtlayout.synth.outlines import SKEW_DEG
from gtlayout.synth.plans import Plan, l_shaped, polygon, slanted, two_rooms
from gtlayout.synth.render import cast
from gtlayout.synth.room import CLEARANCE_M, RoomKind, make_room
from gtlayout.synth.surfaces import Surface

PLANS = (l_shaped, polygon, slanted, two_rooms, bay, round_corner)

every_plan = pytest.mark.parametrize("make", PLANS)


def _plans(make: object) -> list[Plan]:
    assert callable(make)
    return [make(np.random.default_rng([seed, 0])) for seed in range(20)]


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
        assert len(boxes) >= (2 if make is bay else 4)  # nothing stands in a bay, or before it
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
    walls = {"l-shaped": [6], "two-rooms": [8], "polygon": [5, 6], "bay": [6], "round-corner": [5]}.get(kind, [4])
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
