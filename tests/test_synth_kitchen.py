"""Cupboards of synthetic rooms: where they stand, and that they are drawn as annotators draw them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import shapely
from shapely import MultiLineString, Point, Polygon
from synth_views import HEIGHT, WIDTH, camera_at, every_kind

from gtlayout.geometry.raster import fill, rings_of
from gtlayout.scene import Camera, Element, FloatArray, KeyFrame
from gtlayout.synth.annotate import annotate
from gtlayout.synth.extents import seen_extents
from gtlayout.synth.kitchen import DEPTH_M, HEIGHT_M, WORKTOP_M, place_run
from gtlayout.synth.render import cast
from gtlayout.synth.room import CLEARANCE_M, Room, RoomKind, make_room
from gtlayout.synth.surfaces import Surface
from gtlayout.synth.trim import Trim

KITCHEN = Trim(kitchen_share=1.0, plinth_height_m=0.12, plinth_recess_m=0.05, worktop_overhang_m=0.03)
SEED = 3
SIZES = KITCHEN.of_room(np.random.default_rng([SEED, 6]).spawn(1)[0])


@cache
def _kitchen(kind: RoomKind) -> Room:
    return make_room(SEED, kind, trim=KITCHEN)


@cache
def _seen() -> tuple[Camera, KeyFrame, dict[str, str]]:
    """A look at the whole front of a box room's cupboards, three metres away."""
    room, front = _kitchen("box"), _named("front")
    middle = front.corners_world.mean(axis=0)
    camera = camera_at(middle + 2.2 * front.normal + (0.1, 0.2, 0.9), -2.2 * front.normal - (0.1, 0.2, 0.9))
    return camera, *annotate(room, camera, cast(room.surfaces, camera), 0, np.random.default_rng(0))


def _named(side: str) -> Surface:
    return next(s for s in _kitchen("box").building if s.name == f"wall_cupboard_{side}")


def _wall() -> Surface:
    """That behind the cupboards."""
    building = _kitchen("box").building
    lid = next(surface for surface in building if surface.name == "worktop_3")
    return next(surface for surface in building if surface.name == lid.part_of)


def _element(name: str) -> Element:
    _, key_frame, names = _seen()
    return next(element for element in key_frame.elements if names[element.id] == name)


def _on_plane(point_px: tuple[float, float], normal: FloatArray, d: float) -> FloatArray:
    camera, *_ = _seen()
    ray = camera.rays_world(np.array([point_px]))[0]
    return camera.center_world - (normal @ camera.center_world + d) / (ray @ normal) * ray


@every_kind
def test_cupboards_stand_at_a_wall_clear_of_doors_furniture_and_cameras(kind: RoomKind) -> None:
    room = _kitchen(kind)
    front = next(surface for surface in room.structure if surface.name == "wall_cupboard_front")
    left, right = front.corners_world[:2, :2]
    place = Polygon([left, right, right - DEPTH_M * front.normal[:2], left - DEPTH_M * front.normal[:2]])
    floors = [Polygon(s.corners_world[:, :2]) for s in room.structure if s.label == "floor"]
    assert floors[0].buffer(1e-9).covers(place)
    assert place.distance(room.standing) > CLEARANCE_M
    assert 1.6 <= np.linalg.norm(right - left) <= 2.6
    for box in room.furniture:
        assert Polygon(box.corners_world[:, :2]).buffer(0).disjoint(place)
    for door in (surface for surface in room.structure if surface.label == "door"):
        assert shapely.LineString(door.corners_world[:2, :2]).distance(place) > 0.05
    for window in (surface for surface in room.structure if surface.label == "window"):
        assert window.corners_world[:, 2].min() > HEIGHT_M + WORKTOP_M
    names = {surface.name for surface in room.structure if surface.label == "wall"}
    assert names >= {f"wall_cupboard_{side}" for side in ("left", "front", "right")}


def test_the_front_is_drawn_down_to_the_foot_of_the_plinth_and_up_to_the_edge_of_the_worktop() -> None:
    camera, *_ = _seen()
    front, wall = _named("front"), _wall()
    drawn = _element("wall_cupboard_front").amodal
    middle_px = camera.project(front.corners_world.mean(axis=0)[None])[0][0]
    column = shapely.LineString([(middle_px[0], 0), (middle_px[0], HEIGHT)]) & drawn
    _, top_px, _, foot_px = column.bounds
    foot = _on_plane((middle_px[0], foot_px), np.array([0.0, 0, 1]), 0.0)
    assert wall.normal @ foot + wall.d == pytest.approx(DEPTH_M - SIZES.plinth_recess_m, abs=1e-4)
    assert front.normal @ foot + front.d == pytest.approx(-SIZES.plinth_recess_m, abs=1e-4)
    rim_m = DEPTH_M + SIZES.worktop_overhang_m
    rim = _on_plane((middle_px[0], top_px), wall.normal, wall.d - rim_m)
    assert rim[2] == pytest.approx(HEIGHT_M, abs=1e-4), "the worktop's lower edge hides the front's upper one"
    floor = _element("floor").amodal
    assert floor.distance(Point(middle_px[0], foot_px)) < 0.02


def test_front_and_floor_touch_and_the_wall_lies_behind() -> None:
    camera, key_frame, _ = _seen()
    lines = MultiLineString(list(key_frame.occlusion_edges))
    left, right = (camera.project(corner[None])[0][0] for corner in _named("front").corners_world[:2])
    drawn = _element("wall_cupboard_front").amodal
    _, top, _, bottom = drawn.bounds
    for share in (0.2, 0.5, 0.8):
        x = (1 - share) * left[0] + share * right[0]
        _, upper, _, lower = (shapely.LineString([(x, top - 1), (x, bottom + 1)]) & drawn).bounds
        assert lines.distance(Point(x, upper)) < 0.02, "wall and worktop lie behind the front"
        assert lines.distance(Point(x, lower)) > 5, "the plinth joins front and floor"


def test_the_true_extent_of_the_front_is_what_is_drawn_on_its_plane() -> None:
    """Down to where the view of the plinth's foot meets the front's plane: a little above the floor."""
    camera, key_frame, names = _seen()
    extents = seen_extents(_kitchen("box"), [(camera, key_frame, names)])
    corners = np.concatenate(extents["wall_cupboard_front"][0])
    assert 0 < corners[:, 2].min() < 0.3 * SIZES.plinth_height_m
    front = _named("front")
    np.testing.assert_allclose(corners @ front.normal + front.d, 0, atol=1e-9)
    assert HEIGHT_M - 0.1 < corners[:, 2].max() < HEIGHT_M


def test_visible_parts_of_the_front_are_on_the_front() -> None:
    camera, *_ = _seen()
    room = _kitchen("box")
    mask = fill(rings_of(_element("wall_cupboard_front").visible), HEIGHT, WIDTH)
    on = np.unique(cast(room.surfaces, camera).surface[mask])
    assert [room.surfaces[number].name for number in on] == ["wall_cupboard_front"]


def test_where_nothing_fits_there_is_no_kitchen() -> None:
    walls = {"wall_0": np.array([[0.0, 0, 0], [3, 0, 0]])}
    room = shapely.box(0, -3, 3, 0)
    run = place_run(walls, room, np.random.default_rng(0))
    assert run is not None
    assert room.covers(run.place.buffer(-1e-5) & room)
    np.testing.assert_allclose(run.normal, [0, -1, 0], atol=1e-12)
    assert place_run(walls, shapely.box(0, -0.5, 3, 0), np.random.default_rng(0)) is None
    assert place_run({"wall_0": walls["wall_0"] / 2}, room, np.random.default_rng(0)) is None
