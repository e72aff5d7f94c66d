"""Stage 5, what tips the scales: ties, votes that do not count, contacts with gaps, pieces that go whole or in part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import rooms
import shapely
from shapely import MultiPolygon, Polygon, box
from shapely.geometry.base import BaseGeometry

from gtlayout.edges import ContactEdge, EdgeConfig, contact_edges
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.extents import compute_extents
from gtlayout.extent.refine import unproject_edges
from gtlayout.geometry.depth import centroid_of_largest, depth_at_centroid, median_depth
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Extent, Instance, Plane
from gtlayout.scene import Element, FloatArray, Scene

MIDDLE = (rooms.WIDTH_M / 2, 1.0, rooms.HEIGHT_M / 2)
SEEN = (rooms.FLOOR, rooms.CEILING, rooms.LEFT, rooms.RIGHT, rooms.FAR)
LEFT, RIGHT, FAR = 2, 3, 4
CAMERA = rooms.level_camera(MIDDLE)


def in_world(extent: Extent, axes: tuple[int, int]) -> MultiPolygon:
    """The extent seen along a world axis."""
    return polygons(shapely.transform(extent.region, lambda uv: extent.frame.to_world(uv)[:, axes]))


def assert_same(found: shapely.Geometry, expected: shapely.Geometry) -> None:
    assert found.symmetric_difference(expected).area < 1e-6


def partition(width_m: float) -> FloatArray:
    return rooms.rectangle([1.0, 3.5, 0], [width_m, 0, 0], [0, 0, 2.0])


def partition_drawn(widths_m: list[float]) -> tuple[Scene, tuple[rooms.Surface, ...]]:
    """A partition before the far wall, drawn so wide in each key frame; the wall is drawn beside it."""
    surfaces = (rooms.FAR, rooms.Surface("wall", partition(1.5)))
    cameras = [rooms.level_camera((x, 1.0, MIDDLE[2])) for x in np.linspace(1.6, 2.4, len(widths_m))]
    scene = rooms.seen_from(cameras, surfaces)
    for k, (camera, width_m) in enumerate(zip(cameras, widths_m, strict=True)):
        drawn = rooms.draw(partition(width_m), camera)
        scene = rooms.redraw(scene, k, 1, drawn)
        scene = rooms.redraw(scene, k, 0, polygons(rooms.draw(rooms.FAR.corners, camera).difference(drawn)))
    return scene, surfaces


def partition_extent(widths_m: list[float], far_wall_observable: bool = True) -> MultiPolygon:
    scene, surfaces = partition_drawn(widths_m)
    planes = [surface.plane for surface in surfaces]
    planes[0] = replace(planes[0], observable=far_wall_observable)
    instances = rooms.instances_of(surfaces, len(widths_m))
    found = in_world(compute_extents(scene, instances, planes, (), ExtentConfig())[1], (0, 2))
    # Lower down the floor would be seen beside the partition, which nobody draws here.
    return polygons(found.intersection(box(0, 0.5, 4, 2.5)))


def test_a_tie_leaves_what_one_has_drawn() -> None:
    assert_same(partition_extent([2.2, 1.5]), box(1.0, 0.5, 3.2, 2.0))
    assert_same(partition_extent([2.2, 1.5, 1.5]), box(1.0, 0.5, 2.5, 2.0))


def test_a_key_frame_has_one_vote_whatever_it_shows_there() -> None:
    """A window is drawn in the far wall, where the partition ends: one frame says so twice, and is still one."""
    scene, (wall, front) = partition_drawn([2.2, 1.5])
    pane = rooms.rectangle([2.6, 5.0, 0.5], [1.0, 0, 0], [0, 0, 1.4])
    camera = scene.frame_of(1).camera
    window = Element("window", "window", rooms.draw(pane, camera), rooms.draw(pane, camera))
    key_frames = list(scene.key_frames)
    key_frames[1] = replace(key_frames[1], elements=(*key_frames[1].elements, window))
    scene = replace(scene, key_frames=tuple(key_frames))
    instances = (*rooms.instances_of((wall, front), 2), Instance("window_0", "window", ((1, 2),), host=0))
    planes = [wall.plane, front.plane, wall.plane]
    found = in_world(compute_extents(scene, instances, planes, (), ExtentConfig())[1], (0, 2))
    assert_same(found.intersection(box(0, 0.5, 4, 2.5)), box(1.0, 0.5, 3.2, 2.0))


def test_an_unobservable_plane_has_no_vote() -> None:
    """Where its plane is not known, nobody knows whether it lies behind what it was drawn beside."""
    assert_same(partition_extent([2.2, 1.5, 1.5], far_wall_observable=False), box(1.0, 0.5, 3.2, 2.0))


def test_a_wall_votes_about_its_own_door_whatever_is_known_of_it() -> None:
    door = rooms.Surface("door", rooms.rectangle([1.5, 5, 0], [1.0, 0, 0], [0, 0, 2.0]), host=0)
    wide = rooms.rectangle([1.5, 5, 0], [1.8, 0, 0], [0, 0, 2.0])
    cameras = [rooms.level_camera((x, 1.0, MIDDLE[2])) for x in (1.8, 2.0, 2.2)]
    drawings: list[list[rooms.Drawing]] = []
    for k, camera in enumerate(cameras):
        leaf = rooms.draw(wide if k == 0 else door.corners, camera)
        wall = polygons(rooms.draw(rooms.FAR.corners, camera).difference(leaf))
        drawings.append([("wall", wall), ("door", leaf)])
    scene, instances = rooms.make_scene(cameras, drawings), rooms.instances_of((rooms.FAR, door), 3)
    planes = [replace(rooms.FAR.plane, observable=False), door.plane]
    leaf_extent = compute_extents(scene, instances, planes, (), ExtentConfig())[1]
    assert_same(in_world(leaf_extent, (0, 2)), box(1.5, 0, 2.5, 2.0))


def floor_and_far_wall_meet(x: FloatArray) -> dict[tuple[int, int], BaseGeometry]:
    """The contact of floor and far wall, sampled at these x, on both."""
    surfaces = (rooms.FLOOR, rooms.FAR)
    foot = np.column_stack([x, np.full(len(x), 5.0), np.zeros(len(x))])
    return unproject_edges(
        rooms.seen_from([CAMERA], surfaces),
        rooms.instances_of(surfaces, 1),
        [surface.plane for surface in surfaces],
        [surface.extent.frame for surface in surfaces],
        [ContactEdge(0, (0, 1), CAMERA.project(foot)[0])],
        np.inf,
        ExtentConfig(),
    )


def far_wall(scene: Scene, edges: Sequence[ContactEdge], planes: Sequence[Plane] | None = None) -> Extent:
    """Of the room's surfaces, on their own planes unless others are given."""
    planes = planes or [surface.plane for surface in SEEN]
    return compute_extents(scene, rooms.instances_of(SEEN, 1), planes, edges, ExtentConfig())[FAR]


def tongued() -> tuple[Scene, tuple[ContactEdge, ...]]:
    """The far wall with a tongue that reaches 3 m beyond the left wall, .2 m high: 5.7 % of all."""
    wide = rooms.level_camera(MIDDLE, focal=40.0)
    shape = Polygon([(-3, 1.0), (0, 1.0), (0, 0), (4, 0), (4, 2.5), (0, 2.5), (0, 1.2), (-3, 1.2)])
    corners = np.array([[x, rooms.DEPTH_M, z] for x, z in np.array(shape.exterior.coords)[:-1]])
    outline_px, _ = wide.project(corners)
    scene = rooms.redraw(rooms.seen_from([wide], SEEN), 0, FAR, MultiPolygon([Polygon(outline_px)]))
    foot = np.column_stack([np.zeros(20), np.full(20, rooms.DEPTH_M), np.linspace(0, rooms.HEIGHT_M, 20)])
    return scene, (ContactEdge(0, (LEFT, FAR), wide.project(foot)[0]),)


def test_what_pokes_through_goes_to_its_end() -> None:
    scene, edges = tongued()
    far = far_wall(scene, edges)
    assert far.unrefined.area == pytest.approx(10.6, abs=1e-3)
    assert_same(in_world(far, (0, 2)), box(0, 0, 4, 2.5))


@pytest.mark.parametrize(
    ("seen", "left"),
    [((1.0, 1.3), box(-0.3, 0, 4, 2.5).difference(box(-0.3, 1.0, 0, 1.3))), ((0.4, 2.2), box(0, 0, 4, 2.5))],
    ids=["an alcove", "a slip"],
)
def test_a_piece_goes_whole_when_most_of_it_is_alongside(seen: tuple[float, float], left: Polygon) -> None:
    """The wall pokes through over 2.5 m, and the contact is seen over less: over .3 m only these go."""
    wide = rooms.level_camera(MIDDLE, 40.0)
    corners = rooms.rectangle([-0.3, rooms.DEPTH_M, 0], [rooms.WIDTH_M + 0.3, 0, 0], rooms.Z)
    scene = rooms.redraw(rooms.seen_from([wide], SEEN), 0, FAR, rooms.draw(corners, wide))
    foot = np.column_stack([np.full(20, -0.3), np.full(20, rooms.DEPTH_M), np.linspace(*seen, 20)])
    edge = ContactEdge(0, (LEFT, FAR), wide.project(foot)[0])
    far = far_wall(scene, [edge])
    assert_same(in_world(far, (0, 2)), left)


def test_the_side_of_a_contact_is_that_of_what_was_drawn_there() -> None:
    """The left wall is solved .35 m inside the room: most of what borders the contact lies beyond its plane."""
    planes = [surface.plane for surface in SEEN]
    planes[LEFT] = replace(planes[LEFT], d=planes[LEFT].d - 0.35)
    scene, instances = rooms.seen_from([CAMERA], SEEN), rooms.instances_of(SEEN, 1)
    edges = [edge for edge in contact_edges(scene, instances, EdgeConfig()) if set(edge.instances) == {LEFT, FAR}]
    far = compute_extents(scene, instances, planes, edges, ExtentConfig())[FAR]
    assert_same(in_world(far, (0, 2)), box(0.35, 0, 4, 2.5))


def test_contacts_hold_both_ways_and_a_doors_for_its_wall() -> None:
    """A door in the far wall stands on the floor: the floor meets the wall, the wall the floor, and the door it too."""
    door = rooms.Surface("door", rooms.rectangle([1.5, 5, 0], [1.0, 0, 0], [0, 0, 2.0]), host=1)
    surfaces = (rooms.FLOOR, rooms.FAR, door)
    scene, instances = rooms.seen_from([CAMERA], surfaces), rooms.instances_of(surfaces, 1)
    planes = [surface.plane for surface in surfaces]
    frames = [surface.extent.frame for surface in surfaces]
    foot = np.column_stack([np.linspace(1.5, 2.5, 12), np.full(12, 5.0), np.zeros(12)])
    edge = ContactEdge(0, (2, 0), CAMERA.project(foot)[0])
    lines = unproject_edges(scene, instances, planes, frames, [edge], np.inf, ExtentConfig())
    assert set(lines) == {(2, 0), (1, 0), (0, 1)}
    for line in lines.values():
        assert line.length == pytest.approx(1.0)
    planes[0] = replace(planes[0], observable=False)
    assert not unproject_edges(scene, instances, planes, frames, [edge], np.inf, ExtentConfig())


def test_a_hidden_part_of_a_contact_is_no_contact() -> None:
    x = np.concatenate([np.linspace(0.5, 1.0, 11), np.linspace(3.0, 3.5, 11)])
    lines = floor_and_far_wall_meet(x)
    assert lines[0, 1].length == pytest.approx(1.0)
    assert len(lines[0, 1].geoms) == 2


def test_the_scale_of_a_scene_is_of_what_lies_in_front_of_the_camera() -> None:
    """Floor corners drawn above the horizon have negative inverse depths: they say nothing of how far things are."""
    rows = np.array([10.0, 20.0, 75.0, 100.0])  # depths on the floor: behind, behind, 4 m, 2 m
    outline = Polygon([(40, rows[0]), (120, rows[1]), (120, rows[2]), (40, rows[3])])
    scene = rooms.make_scene([CAMERA], [[("floor", MultiPolygon([outline]))]])
    found = median_depth(scene, rooms.instances_of((rooms.FLOOR,), 1), [rooms.FLOOR.plane])
    # A ring's first vertex counts twice.
    assert found == pytest.approx(3.0)


def test_an_instance_is_judged_where_most_of_it_was_drawn() -> None:
    near, far = rooms.level_camera(MIDDLE), rooms.level_camera((2.0, 3.0, 1.25))
    scene = rooms.make_scene(
        [near, far], [[("wall", rooms.pixels(60, 30, 70, 40))], [("wall", rooms.pixels(20, 10, 80, 70))]]
    )
    instance = Instance("wall_0", "wall", ((0, 0), (1, 0)))
    camera, centroid_px = centroid_of_largest(scene, instance)
    assert camera is far
    np.testing.assert_allclose(centroid_px, [[50.0, 40.0]])
    sigma = replace(rooms.FAR.plane, covariance=np.diag([0, 0, 0, 0.25]))
    assert depth_at_centroid(scene, instance, sigma) == pytest.approx((0.5, 2.0))


def test_planes_that_are_nowhere_have_no_depth() -> None:
    scene = rooms.make_scene([CAMERA], [[("floor", rooms.pixels(40, 10, 120, 20))]])
    plane: Plane = rooms.FLOOR.plane
    sigma, depth = depth_at_centroid(scene, rooms.instances_of((rooms.FLOOR,), 1)[0], plane)
    assert np.isnan(sigma) and np.isnan(depth)


def far_wall_short_of(left_m: float, right_m: float) -> tuple[Scene, list[ContactEdge]]:
    """The far wall drawn so much short of both side walls, and contacts half-way."""
    corners = rooms.rectangle([left_m, rooms.DEPTH_M, 0], [rooms.WIDTH_M - left_m - right_m, 0, 0], rooms.Z)
    scene = rooms.redraw(rooms.seen_from([CAMERA], SEEN), 0, FAR, rooms.draw(corners, CAMERA))
    edges = []
    for side, x in ((LEFT, left_m / 2), (RIGHT, rooms.WIDTH_M - right_m / 2)):
        foot = np.column_stack([np.full(20, x), np.full(20, rooms.DEPTH_M), np.linspace(0, rooms.HEIGHT_M, 20)])
        edges.append(ContactEdge(0, (side, FAR), CAMERA.project(foot)[0]))
    return scene, edges


@pytest.mark.parametrize(("right_share", "closed"), [(0.095, True), (0.103, False)])
def test_every_gap_is_measured_by_what_was_drawn(right_share: float, closed: bool) -> None:
    """Two gaps, of 5 % and so much of what is drawn: closing the first does not make room for the second."""
    drawn_m = rooms.WIDTH_M / (1 + 0.05 + right_share)
    scene, edges = far_wall_short_of(0.05 * drawn_m, right_share * drawn_m)
    far = far_wall(scene, edges)
    assert_same(in_world(far, (0, 2)), box(0, 0, 4.0 if closed else 1.05 * drawn_m, 2.5))


def test_a_gap_is_closed_along_its_contact_and_no_farther() -> None:
    """The contact, .1 m off, is seen over the lower 1.25 m: it reaches twice its distance beyond its ends."""
    scene, _ = far_wall_short_of(0.2, 0.0)
    foot = np.column_stack([np.full(20, 0.1), np.full(20, rooms.DEPTH_M), np.linspace(0, 1.25, 20)])
    edge = ContactEdge(0, (LEFT, FAR), CAMERA.project(foot)[0])
    far = far_wall(scene, [edge])
    grown = in_world(far, (0, 2)).difference(box(0.2, 0, 4, 2.5))
    assert grown.area == pytest.approx(0.2 * (1.25 + np.sqrt(0.2**2 - 0.1**2)), rel=0.01)


@pytest.mark.parametrize("samples", [1, 2])
def test_a_sample_by_itself_is_no_contact(samples: int) -> None:
    x = np.array([0.5, *np.linspace(2.0, 2.5, 11)]) if samples == 2 else np.array([0.5])
    lines = floor_and_far_wall_meet(x)
    assert sum(line.length for line in lines.values()) == pytest.approx(1.0 if samples == 2 else 0.0)


def test_a_slanted_ceiling_cuts_off_the_corner_of_the_wall_below_it() -> None:
    """From (3, 2.5) down to (4, 1.5) in the far wall, which was drawn up to its corner: 5 % of it."""
    slope = np.array([-1.0, 0.0, -1.0]) / np.sqrt(2)
    slanted = Plane(slope, -float(slope @ [3, 5, 2.5]), np.zeros((4, 4)), observable=True)
    scene = rooms.seen_from([CAMERA], SEEN)
    along = np.linspace([3, 5, 2.5], [4, 5, 1.5], 20)
    edge = ContactEdge(0, (1, FAR), CAMERA.project(along)[0])
    planes = [surface.plane for surface in SEEN]
    planes[1] = slanted
    instances = list(rooms.instances_of(SEEN, 1))
    instances[1] = replace(instances[1], label="slanted", name="slanted_1")
    far = compute_extents(scene, instances, planes, [edge], ExtentConfig())[FAR]
    assert_same(in_world(far, (0, 2)), Polygon([(0, 0), (4, 0), (4, 1.5), (3, 2.5), (0, 2.5)]))
