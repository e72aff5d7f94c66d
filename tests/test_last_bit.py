"""No decision hangs on the last bit: input moved by less than another processor's rounding gives the same result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rooms
import shapely
from box_room import made
from shapely import MultiPolygon

from gtlayout.correspondence.matching import _join_across_gaps
from gtlayout.edges import EdgeConfig, contact_edges
from gtlayout.export.floor_plan import floor_plan
from gtlayout.export.plan_drawing import draw
from gtlayout.export.svg import svg_text
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.extents import compute_extents
from gtlayout.geometry.hosts import find_hosts
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Extent, Instance, Mesh, Plane, PlaneFrame
from gtlayout.io.annotations.elements import DrawnElement, DrawnVisible, assemble
from gtlayout.mesh import build_mesh
from gtlayout.regrouping.splits import _with_the_others
from gtlayout.scene import FloatArray, Label, Scene
from gtlayout.synth import textures
from gtlayout.synth.furniture import furnish
from gtlayout.synth.plans import Plan, l_shaped, polygon, slanted, two_rooms
from gtlayout.synth.surfaces import Box, make_surface

JITTERS = 4
ROUNDING = 1e-15
"""As much as the planes of one scene differ between two kinds of processor, relative."""
HAND_PX = 1.5
PLANE_M = 0.02
SURFACES = (
    rooms.FLOOR,
    rooms.CEILING,
    rooms.LEFT,
    rooms.RIGHT,
    rooms.FAR,
    rooms.Surface("door", rooms.rectangle([1.5, rooms.DEPTH_M, 0], [1.0, 0, 0], [0, 0, 2.0]), host=4),
)


def _by_hand(region: MultiPolygon, rng: np.random.Generator) -> MultiPolygon:
    """Each corner drawn a little off, with one more on every side."""
    corners = shapely.get_coordinates(shapely.segmentize(region, 30.0))[:-1]
    return polygons(shapely.polygons(corners + rng.uniform(-HAND_PX, HAND_PX, corners.shape)))


def _drawn_room(seed: int) -> tuple[Scene, list[Plane]]:
    """Four key frames of the box room as a hand draws them, and planes that are a little off, as solved ones are."""
    rng = np.random.default_rng(seed)
    cameras = [rooms.level_camera((x, 0.8, 1.25)) for x in (1.6, 1.9, 2.1, 2.4)]
    drawings = [[(s.label, _by_hand(rooms.draw(s.corners, camera), rng)) for s in SURFACES] for camera in cameras]
    planes = []
    for surface in SURFACES:
        exact = surface.plane
        normal = exact.normal + rng.normal(0, 0.01, 3)
        planes.append(replace(exact, normal=normal / np.linalg.norm(normal), d=exact.d + float(rng.normal(0, PLANE_M))))
    return rooms.make_scene(cameras, drawings), planes


def _noisy(values: FloatArray, rng: np.random.Generator) -> FloatArray:
    return values + ROUNDING * np.abs(values).max() * rng.standard_normal(values.shape)


def _redrawn(region: shapely.Geometry, rng: np.random.Generator) -> shapely.Geometry:
    """Equal corners stay equal: rings stay closed."""

    def noisy(xy: FloatArray) -> FloatArray:
        corners, corner = np.unique(xy, axis=0, return_inverse=True)
        return _noisy(corners, rng)[corner]

    return shapely.transform(region, noisy)


def _moved(planes: Sequence[Plane], rng: np.random.Generator) -> list[Plane]:
    moved = []
    for plane in planes:
        noisy = _noisy(np.append(plane.normal, plane.d), rng)
        moved.append(replace(plane, normal=noisy[:3] / np.linalg.norm(noisy[:3]), d=float(noisy[3])))
    return moved


def _surfaces(scene: Scene, instances: tuple[Instance, ...], planes: list[Plane]) -> tuple[tuple[Extent, ...], Mesh]:
    edges = contact_edges(scene, instances, EdgeConfig())
    extents = compute_extents(scene, instances, planes, edges, ExtentConfig())
    return extents, build_mesh(instances, extents)


@pytest.mark.parametrize("seed", range(2))
def test_extents_and_mesh_are_the_same_when_planes_differ_by_rounding(seed: int) -> None:
    scene, planes = _drawn_room(seed)
    instances = rooms.instances_of(SURFACES, len(scene.key_frames))
    extents, mesh = _surfaces(scene, instances, planes)
    for jitter in range(JITTERS):
        moved, moved_mesh = _surfaces(scene, instances, _moved(planes, np.random.default_rng(jitter)))
        for one, other in zip(extents, moved, strict=True):
            for before, after in ((one.unrefined, other.unrefined), (one.region, other.region)):
                corners, others = shapely.get_coordinates(before), shapely.get_coordinates(after)
                assert len(corners) == len(others)
                np.testing.assert_allclose(corners, others, atol=1e-7)
        np.testing.assert_array_equal(mesh.faces, moved_mesh.faces)
        np.testing.assert_allclose(mesh.vertices, moved_mesh.vertices, atol=1e-7)


@pytest.mark.parametrize("make", [l_shaped, polygon, slanted, two_rooms])
def test_furniture_stands_where_it_stood_when_the_plan_differs_by_rounding(
    make: Callable[[np.random.Generator], Plan],
) -> None:
    """Clear places begin at walls: outlines that run on top of each other, but for rounding."""
    for seed in range(10):
        plan = make(np.random.default_rng([seed, 0]))
        boxes = furnish(plan, np.random.default_rng(seed))
        rng = np.random.default_rng(seed)
        noisy = replace(
            plan,
            panels=tuple(replace(panel, corners_world=_noisy(panel.corners_world, rng)) for panel in plan.panels),
            **{name: _redrawn(getattr(plan, name), rng) for name in ("clear", "upright")},
        )
        others = furnish(noisy, np.random.default_rng(seed))
        assert len(boxes) == len(others) >= 4
        for one, other in zip(boxes, others, strict=True):
            np.testing.assert_allclose(one.centre, other.centre, atol=1e-9)


def test_a_turned_box_keeps_the_size_of_its_textures() -> None:
    """0.7 x 0.42 x 0.3 m are whole numbers of texels, whatever rounding makes of them."""
    shapes = set()

    def paint(_rng: np.random.Generator, shape: tuple[int, int]) -> textures.Texture:
        shapes.add(tuple(sorted(shape)))
        return np.zeros((*shape, 3), dtype=np.float32)

    for yaw in np.linspace(0, 6, 25):
        for face in Box(np.array([1.0, 2.0, 0.15]), np.array([0.7, 0.42, 0.3]), float(yaw), paint).faces():
            make_surface("box_0", None, face, paint, lambda points, _n: np.ones(len(points)), np.random.default_rng(0))
    assert shapes == {(105, 175), (75, 175), (75, 105)}


def test_a_contact_edge_of_a_whole_number_of_steps_has_as_many_samples() -> None:
    """Two squares that touch along 42 px, and round each corner as far as the gap allows: 50 px, 2 + 12 * 4."""
    squares = [rooms.pixels(10, 15, 50, 57), rooms.pixels(50, 15, 90, 57)]
    instances = rooms.instances_of([rooms.FAR, rooms.FAR], 1)
    counts = set()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        drawn = [_redrawn(square, rng) for square in squares]
        scene = rooms.make_scene([rooms.facing_camera()], [[("wall", region) for region in drawn]])
        (edge,) = contact_edges(scene, instances, EdgeConfig())
        counts.add((len(edge.points_px), bool(edge.points_px[0, 1] < edge.points_px[-1, 1])))
    assert len(counts) == 1


def test_of_two_walls_that_share_as_much_of_a_door_the_first_is_its_host() -> None:
    labels: tuple[Label, ...] = ("door", "wall", "wall")
    instances = [Instance(f"{label}_{i}", label, ((0, i),)) for i, label in enumerate(labels)]
    drawn = rooms.pixels(30, 20, 50, 60), rooms.pixels(10, 10, 40, 70), rooms.pixels(40, 10, 70, 70)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        door, *walls = (_redrawn(region, rng) for region in drawn)
        scene = rooms.make_scene([rooms.facing_camera()], [[("door", door), *(("wall", wall) for wall in walls)]])
        assert find_hosts(scene, instances) == [1, None, None]


def test_a_visible_part_that_overlaps_two_elements_alike_belongs_to_the_smaller_one() -> None:
    """By 21 x 22.5 px, a whole number and a half: rounding is not to say that it overlaps one of them more."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        whole = [
            DrawnElement("wall", _redrawn(rooms.pixels(*bounds), rng), MultiPolygon(), name, None, 0)
            for name, bounds in (("large", (0, 0, 41, 70)), ("small", (10, 10, 41, 50)))
        ]
        elements, _ = assemble(whole, [DrawnVisible(rooms.pixels(20, 20, 45, 42.5), None, None)])
        assert [element.id for element in elements if not element.visible.is_empty] == ["small"]


def test_the_plan_lies_along_the_first_of_two_walls_as_long(tmp_path: Path) -> None:
    scene, layout = made(tmp_path)
    axes = floor_plan(scene, layout).frame.axes
    for seed in range(20):
        noisy = replace(layout, planes=tuple(_moved(layout.planes, np.random.default_rng(seed))))
        np.testing.assert_allclose(floor_plan(scene, noisy).frame.axes, axes, atol=1e-9)


def test_the_plan_is_drawn_alike(tmp_path: Path) -> None:
    """With two sides as long, a room whose middle is anywhere along a line, and labels with several places as good."""
    scene, layout = made(tmp_path)
    drawn = svg_text(draw(floor_plan(scene, layout)), "m")
    for seed in range(10):
        rng = np.random.default_rng(seed)
        extents = tuple(replace(one, region=_redrawn(one.region, rng)) for one in layout.extents)
        noisy = replace(layout, planes=tuple(_moved(layout.planes, rng)), extents=extents)
        assert svg_text(draw(floor_plan(scene, noisy)), "m") == drawn


def test_the_frame_of_a_level_plane_does_not_turn() -> None:
    level = np.array([0.0, 0.0, 1.0])
    axes = PlaneFrame.across(level, np.zeros(3)).axes
    for seed in range(20):
        normal = _noisy(level, np.random.default_rng(seed))
        np.testing.assert_allclose(PlaneFrame.across(normal / np.linalg.norm(normal), level).axes, axes, atol=1e-9)


def test_a_drawing_that_lies_within_both_halves_of_a_split_goes_to_the_larger_one() -> None:
    cameras = [rooms.level_camera([x, 0, 0], focal=100.0, width=100, height=80) for x in (-0.3, 0.0, 0.4, 0.1)]
    drawn = [rooms.pixels(5, 5, 95, 75)] * 3 + [rooms.pixels(37.3, 31.7, 62.9, 48.3)]
    scene = rooms.make_scene(cameras, [[("wall", region)] for region in drawn])
    instance = Instance("wall_0", "wall", tuple((k, 0) for k in range(4)))
    parts = (((2, 0),), ((0, 0), (1, 0)))
    near = rooms.facing(0, 0, 100, 80).plane
    for seed in range(20):
        sides = tuple(_moved([near, replace(near, d=1.1 * near.d)], np.random.default_rng(seed)))
        whole = _with_the_others(scene, instance, parts, sides, 100.0, ExtentConfig())
        assert whole == (((2, 0),), ((0, 0), (1, 0), (3, 0)))


def test_chains_with_as_many_votes_are_joined_in_order() -> None:
    """The chain of two key frames has 3 votes for each of two others, in shares that add up to 3 but for rounding."""
    votes = np.zeros((4, 4))
    votes[0, 2] = votes[1, 3] = 1.1
    votes[1, 2] = votes[0, 3] = 1.9
    for seed in range(20):
        noisy = _noisy(votes + votes.T, np.random.default_rng(seed))
        joined = _join_across_gaps(np.array([0, 0, 1, 2]), np.array([0, 1, 2, 2]), noisy, 3.0)
        assert joined.tolist() == [0, 0, 0, 2]
