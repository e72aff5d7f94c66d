"""Trim of synthetic rooms: where a person draws lines that are not those of the planes, by how much, and what stays."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely
from shapely import MultiLineString, Polygon
from synth_views import HEIGHT, WIDTH, Drawn, every_kind, views_of

from gtlayout.geometry.raster import fill, rings_of
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import read_truth
from gtlayout.scene import OPENINGS, Camera, Element, FloatArray
from gtlayout.synth import SynthConfig, synthesize
from gtlayout.synth.annotate import annotate, draw, occlusion_edges
from gtlayout.synth.baseboards import fit_baseboards
from gtlayout.synth.errors import AnnotatorErrors
from gtlayout.synth.fitting import Fitter
from gtlayout.synth.render import cast
from gtlayout.synth.room import Room, RoomKind, make_room
from gtlayout.synth.surfaces import Surface
from gtlayout.synth.textures import plain
from gtlayout.synth.trim import HOME_TRIM, NO_TRIM, Trim

BASEBOARDS = Trim(baseboard_height_m=0.08, baseboard_thickness_m=0.015, baseboard_share=1.0)
WITHOUT_KITCHEN = replace(HOME_TRIM, kitchen_share=0)
ALL = replace(HOME_TRIM, kitchen_share=1.0)
OUTER, LEAF = 1, 3
"""Seeds of rooms whose openings are drawn with their reveals, and without them."""


@cache
def _room(kind: RoomKind, trim: Trim, seed: int = OUTER) -> Room:
    return make_room(seed, kind, trim=trim)


@cache
def _drawn(kind: RoomKind, trim: Trim, seed: int = OUTER) -> tuple[tuple[Camera, Drawn], ...]:
    room = _room(kind, trim, seed)
    cameras = views_of(room)[:4]
    return tuple((c, annotate(room, c, cast(room.surfaces, c), 0, np.random.default_rng(0))) for c in cameras)


def _named(room: Room, name: str) -> Surface:
    return next(surface for surface in room.building if surface.name == name)


def _sizes(trim: Trim, seed: int) -> Trim:
    """Of the room with that seed."""
    return trim.of_room(np.random.default_rng([seed, 6]).spawn(1)[0])


def _element(drawn: Drawn, name: str) -> Element | None:
    return next((e for e in drawn[0].elements if drawn[1][e.id] == name), None)


def _on_plane(points_px: FloatArray, camera: Camera, normal: FloatArray, d: float) -> FloatArray:
    rays = camera.rays_world(points_px)
    return camera.center_world - ((normal @ camera.center_world + d) / (rays @ normal))[:, None] * rays


def _edges(element: Element) -> FloatArray:
    """(N, 2, 2) px edges of an element that do not run along the image's border."""
    edges = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings_of(element.amodal)])
    borders = ((0, 0), (0, WIDTH), (1, 0), (1, HEIGHT))
    on_border = [(np.abs(edges[:, :, axis] - at) < 1e-3).all(axis=1) for axis, at in borders]
    return edges[~np.any(on_border, axis=0) & (np.ptp(edges, axis=1).max(axis=1) > 0)]


@every_kind
def test_what_is_drawn_is_what_the_empty_room_looks_like_with_trim_as_part_of_its_surface(kind: RoomKind) -> None:
    seed = OUTER if kind in ("box", "slanted") else LEAF
    room = _room(kind, ALL, seed)
    index = {surface.name: number for number, surface in enumerate(room.building)}
    drawn_with = np.array(
        [index[s.part_of] if s.label is None and s.part_of else number for number, s in enumerate(room.building)]
    )
    for camera, (key_frame, names) in _drawn(kind, ALL, seed):
        hits = cast(room.building, camera).surface
        assert (hits >= 0).all()
        seen = drawn_with[hits]
        labels = np.full(seen.shape, -1)
        for element in sorted(key_frame.elements, key=lambda e: e.label in OPENINGS):
            assert element.amodal.is_valid
            labels[fill(rings_of(element.amodal), HEIGHT, WIDTH)] = index[names[element.id]]
        reach = np.ones((7, 7), np.uint8)  # steps of less than 2.5 px are not drawn
        inner = cv2.erode(seen.astype(np.int16), reach) == cv2.dilate(seen.astype(np.int16), reach)
        known = np.isin(seen, [index[name] for name in names.values()])  # slivers of doors are left to their wall
        assert (labels == seen)[inner & known & (labels >= 0)].all()
        assert (inner & known & (labels < 0)).mean() < 0.01
        furnished = cast(room.surfaces, camera).surface
        for element in key_frame.elements:
            on = np.unique(furnished[fill(rings_of(element.visible), HEIGHT, WIDTH)])
            assert {room.surfaces[number].name for number in on} <= {names[element.id]}, "no visible part on trim"


def test_the_floor_is_drawn_up_to_the_foot_of_the_baseboards() -> None:
    """The drawn line lies in front of the line where floor and wall meet by exactly the baseboard's thickness."""
    room, thickness_m = _room("box", BASEBOARDS), _sizes(BASEBOARDS, OUTER).baseboard_thickness_m
    walls = [surface for surface in room.structure if surface.label == "wall"]
    door = Polygon(_named(room, "door_0").corners_world[:, :2]).buffer(0.05)
    floor, feet = _named(room, "floor"), 0
    for camera, drawn in _drawn("box", BASEBOARDS):
        element = _element(drawn, "floor")
        assert element is not None
        for edge in _edges(element):
            middle = _on_plane(edge.mean(axis=0)[None], camera, floor.normal, floor.d)[0]
            if door.contains(shapely.Point(middle[:2])):
                continue
            off_m = min(float(wall.normal @ middle + wall.d) for wall in walls)
            assert off_m == pytest.approx(thickness_m, abs=1e-4)
            wall = min(walls, key=lambda wall: float(wall.normal @ middle + wall.d))
            drawn_wall = _element(drawn, wall.name)
            assert drawn_wall is not None
            assert drawn_wall.amodal.distance(shapely.Point(edge.mean(axis=0))) < 0.02, "the wall begins there"
            feet += 1
    assert feet >= 10


@every_kind
def test_baseboards_stand_on_the_floor_before_a_share_of_the_walls_and_not_before_doors(kind: RoomKind) -> None:
    room, sizes = _room(kind, ALL), _sizes(ALL, OUTER)
    floors = shapely.union_all([Polygon(s.corners_world[:, :2]) for s in room.structure if s.label == "floor"])
    boards = [surface for surface in room.building if "_baseboard_" in surface.name]
    for board in boards:
        assert board.part_of is not None
        wall = _named(room, board.part_of)
        assert floors.buffer(1e-9).covers(shapely.MultiPoint(board.corners_world[:, :2]))
        assert board.corners_world[:, 2].max() == pytest.approx(sizes.baseboard_height_m)
        off_m = board.corners_world @ wall.normal + wall.d
        assert off_m.min() > -1e-9
        assert off_m.max() == pytest.approx(sizes.baseboard_thickness_m)
    for door in (surface for surface in room.structure if surface.label == "door"):
        assert not any(_before(door).intersects(shapely.MultiPoint(board.corners_world[:, :2])) for board in boards)
    walls = sum(s.label == "wall" and not s.name.startswith("wall_cupboard") for s in room.structure)
    assert 0 < len({board.part_of for board in boards}) <= walls


def test_a_share_of_the_walls_has_baseboards() -> None:
    wall = _room("box", NO_TRIM).structure[2:6]
    fitter = Fitter(np.array([[2.0, 2, 2]]), (), np.random.default_rng(0))
    paint = partial(plain, colour=(200, 200, 200), contrast=3)
    fitted = [
        {board.part_of for board in fit_baseboards(wall, (0.01, 0.01), 0.7, {}, paint, fitter)} for _ in range(20)
    ]
    assert 0.6 < np.mean([len(names) / 4 for names in fitted]) < 0.8


def _before(door: Surface) -> Polygon:
    """The place before a door but for its edges, x and y."""
    left, right = door.corners_world[:2, :2]
    inset = 0.01 * (right - left)
    out = 0.1 * door.normal[:2]
    return Polygon([left + inset - out, right - inset - out, right - inset + out, left + inset + out])


@pytest.mark.parametrize(("seed", "with_reveal"), [(OUTER, True), (LEAF, False)])
def test_doors_and_windows_lie_behind_their_wall_and_are_drawn_one_way_per_room(seed: int, with_reveal: bool) -> None:
    bare, room, sizes = _room("box", NO_TRIM, seed), _room("box", WITHOUT_KITCHEN, seed), _sizes(WITHOUT_KITCHEN, seed)
    depths_m = {"door_0": sizes.door_reveal_m, "window_0": sizes.window_reveal_m}
    found = 0
    for name, depth_m in depths_m.items():
        opening, before = _named(room, name), _named(bare, name)
        assert opening.d - before.d == pytest.approx(depth_m), "the truth is the leaf's plane"
        np.testing.assert_allclose(opening.normal, before.normal)
        for camera, drawn in _drawn("box", WITHOUT_KITCHEN, seed):
            element = _element(drawn, name)
            if element is None or any(_touches_border(ring) for ring in rings_of(element.amodal)):
                continue
            hole = Polygon(camera.project(before.corners_world)[0])
            leaf = Polygon(camera.project(opening.corners_world)[0])
            expected = hole if with_reveal else hole & leaf
            assert element.amodal.symmetric_difference(expected).area < 0.002 * hole.area
            assert (hole - leaf).area > 0.01 * hole.area, "the two ways differ"
            assert leaf.buffer(1e-6).covers(element.visible)
            found += 1
    assert found >= 3


def _touches_border(ring: FloatArray) -> bool:
    return bool((ring.min() < 1e-3) or (ring > (WIDTH - 1e-3, HEIGHT - 1e-3)).any())


def test_nobody_draws_occlusion_edges_round_trim() -> None:
    """A box room without trim has none, and none come with baseboards and reveals."""
    for seed in (OUTER, LEAF):
        assert {len(drawn[0].occlusion_edges) for _, drawn in _drawn("box", WITHOUT_KITCHEN, seed)} == {0}


@pytest.mark.parametrize("kind", ["l-shaped", "two-rooms"])
def test_occlusion_edges_of_walls_stay(kind: RoomKind) -> None:
    """But for the lowest hand's breadth, which a baseboard moves."""
    rooms = _room(kind, NO_TRIM), _room(kind, WITHOUT_KITCHEN)
    for camera in views_of(rooms[0]):
        bare, trimmed = (MultiLineString(list(occlusion_edges(draw(room.building, camera), camera))) for room in rooms)
        assert bare.difference(trimmed.buffer(1)).length < 0.05 * bare.length + 1
        assert trimmed.difference(bare.buffer(1)).length < 0.05 * trimmed.length + 1


def test_depth_lies_on_the_true_planes(tmp_path: Path) -> None:
    config = SynthConfig(
        LEAF, frames=3, key_every=2, width=160, height=120, trim=ALL, annotator=AnnotatorErrors(corner_sigma_px=0)
    )
    synthesize(tmp_path / "room", config)
    scene = load_scene(tmp_path / "room")
    assert not scene.warnings
    truth = read_truth(scene)
    assert truth is not None
    for k, key_frame in enumerate(scene.key_frames):
        frame = scene.frame_of(k)
        depth_mm = cv2.imread(str(frame.depth_path), cv2.IMREAD_UNCHANGED)
        assert depth_mm is not None
        y, x = np.mgrid[:120, :160] + 0.5
        rays = frame.camera.rays_world(np.column_stack([x.ravel(), y.ravel()]))
        points = frame.camera.center_world + rays * depth_mm.ravel()[:, None] / 1000
        for e, element in enumerate(key_frame.elements):
            plane = truth.planes[truth.elements[k, e]]
            mask = fill(rings_of(element.visible), 120, 160).ravel()
            assert np.abs(points[mask] @ plane.normal + plane.d).max(initial=0) < 0.0006
