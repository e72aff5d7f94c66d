"""Stage 5: exact planes and exact polygons give exact extents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
import rooms
import shapely
from shapely import LineString, MultiLineString, MultiPolygon, Polygon, box

from gtlayout.edges import ContactEdge, EdgeConfig, contact_edges
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.extents import compute_extents
from gtlayout.geometry.depth import median_depth
from gtlayout.geometry.plane_image import clip_to_plane, unproject
from gtlayout.geometry.polygons import buffered, cut, polygons
from gtlayout.instances import Extent, Instance, Plane
from gtlayout.scene import FloatArray, Scene

MIDDLE = (rooms.WIDTH_M / 2, 1.0, rooms.HEIGHT_M / 2)
"""From here the camera sees all that lies beyond y = 3, and nothing else."""
SEEN = (rooms.FLOOR, rooms.CEILING, rooms.LEFT, rooms.RIGHT, rooms.FAR)
LEFT, FAR = 2, 4


def _extents(
    scene: Scene,
    surfaces: Sequence[rooms.Surface],
    edges: Sequence[ContactEdge] = (),
    config: ExtentConfig | None = None,
) -> tuple[Extent, ...]:
    instances = rooms.instances_of(surfaces, len(scene.key_frames))
    return compute_extents(scene, instances, [s.plane for s in surfaces], edges, config or ExtentConfig())


def _world_polygon(extent: Extent, axes: tuple[int, int]) -> Polygon:
    """The extent seen along a world axis."""
    (part,) = extent.region.geoms
    return Polygon(extent.frame.to_world(np.array(part.exterior.coords))[:, axes])


def _assert_same(found: Polygon | MultiPolygon, expected: Polygon, tolerance: float = 1e-7) -> None:
    assert found.symmetric_difference(expected).area < tolerance


def _expected_from(y_m: float) -> list[tuple[tuple[int, int], Polygon]]:
    """Per surface of SEEN: the two world axes it spans, and its part beyond y_m in them."""
    floor, side = box(0, y_m, rooms.WIDTH_M, rooms.DEPTH_M), box(y_m, 0, rooms.DEPTH_M, rooms.HEIGHT_M)
    far = box(0, 0, rooms.WIDTH_M, rooms.HEIGHT_M)
    return [((0, 1), floor), ((0, 1), floor), ((1, 2), side), ((1, 2), side), ((0, 2), far)]


def test_exact_planes_and_polygons_give_exact_rectangles() -> None:
    scene = rooms.seen_from([rooms.level_camera(MIDDLE)], SEEN)
    edges = contact_edges(scene, rooms.instances_of(SEEN, 1), EdgeConfig())
    assert len(edges) == 8
    for with_edges in ((), edges):
        extents = _extents(scene, SEEN, with_edges)
        for extent, surface, (axes, expected) in zip(extents, SEEN, _expected_from(3.0), strict=True):
            _assert_same(_world_polygon(extent, axes), expected)
            _assert_same(extent.unrefined, extent.region)
            np.testing.assert_allclose(np.cross(*extent.frame.axes), surface.plane.normal, atol=1e-12)
            assert abs(surface.plane.normal @ extent.frame.origin + surface.plane.d) < 1e-12


def test_key_frames_add_up_to_what_all_of_them_see() -> None:
    cameras = [rooms.level_camera((MIDDLE[0], y, MIDDLE[2])) for y in (1.0, 0.5, 0.2)]
    for extent, (axes, expected) in zip(
        _extents(rooms.seen_from(cameras, SEEN), SEEN), _expected_from(2.2), strict=True
    ):
        _assert_same(_world_polygon(extent, axes), expected)


def test_unobservable_plane_has_no_extent_and_does_not_disturb_others() -> None:
    scene = rooms.seen_from([rooms.level_camera(MIDDLE)], SEEN)
    instances = rooms.instances_of(SEEN, 1)
    edges = contact_edges(scene, instances, EdgeConfig())
    planes = [surface.plane for surface in SEEN]
    planes[LEFT] = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False)
    extents = compute_extents(scene, instances, planes, edges, ExtentConfig())
    assert extents[LEFT].region.is_empty
    assert extents[LEFT].unrefined.is_empty
    assert extents[FAR].region.area == pytest.approx(10.0)
    nowhere = [replace(plane, observable=False) for plane in planes]
    assert all(e.region.is_empty for e in compute_extents(scene, instances, nowhere, edges, ExtentConfig()))
    assert median_depth(scene, instances, nowhere) == np.inf


def _far_wall_from(left_m: float) -> tuple[Scene, tuple[ContactEdge, ...]]:
    """The far wall drawn from x = left_m instead of 0, and the contact edge half-way, as two hands would have it."""
    camera = rooms.level_camera(MIDDLE)
    drawn = rooms.rectangle([left_m, rooms.DEPTH_M, 0], [rooms.WIDTH_M - left_m, 0, 0], rooms.Z)
    scene = rooms.redraw(rooms.seen_from([camera], SEEN), 0, FAR, rooms.draw(drawn, camera))
    line = np.column_stack([np.full(20, left_m / 2), np.full(20, rooms.DEPTH_M), np.linspace(0, rooms.HEIGHT_M, 20)])
    return scene, (ContactEdge(0, (LEFT, FAR), camera.project(line)[0]),)


@pytest.mark.parametrize(("share", "closed"), [(0.09, True), (0.11, False)])
def test_gap_to_the_neighbours_plane_is_closed_when_it_is_small(share: float, closed: bool) -> None:
    """Grown by ``share`` of its area: 10 m² / (1 + share) of the wall are drawn."""
    left_m = rooms.WIDTH_M * share / (1 + share)
    scene, edges = _far_wall_from(left_m)
    far = _extents(scene, SEEN, edges)[FAR]
    assert far.unrefined.area == pytest.approx(10.0 / (1 + share))
    start = 0.0 if closed else left_m
    _assert_same(_world_polygon(far, (0, 2)), box(start, 0, rooms.WIDTH_M, rooms.HEIGHT_M))
    # Without a contact edge nothing says that the two meet.
    assert _extents(scene, SEEN)[FAR].region.area == pytest.approx(10.0 / (1 + share))


@pytest.mark.parametrize(("share", "cut"), [(0.09, True), (0.11, False)])
def test_what_pokes_through_the_neighbour_is_cut_when_it_is_small(share: float, cut: bool) -> None:
    """A piece of ``share`` of the drawn area lies beyond x = 0."""
    left_m = -rooms.WIDTH_M * share / (1 - share)
    scene, edges = _far_wall_from(left_m)
    far = _extents(scene, SEEN, edges)[FAR]
    assert far.unrefined.area == pytest.approx(10.0 / (1 - share))
    start = 0.0 if cut else left_m
    _assert_same(_world_polygon(far, (0, 2)), box(start, 0, rooms.WIDTH_M, rooms.HEIGHT_M))


def test_nearly_parallel_neighbours_are_not_refined() -> None:
    """The far wall and a panel turned against it by 5°: their line of intersection may lie anywhere."""
    turn = np.deg2rad(5.0)
    panel = rooms.Surface(
        "wall", rooms.rectangle([0, 5, 0], [-np.cos(turn), np.sin(turn), 0], [0, 0, 2.5])[[1, 0, 3, 2]]
    )
    surfaces = (rooms.FAR, panel)
    scene, edges = _far_wall_from(0.2)
    camera = scene.frame_of(0).camera
    scene = rooms.make_scene(
        [camera], [[("wall", scene.key_frames[0].elements[FAR].amodal), ("wall", rooms.draw(panel.corners, camera))]]
    )
    far = _extents(scene, surfaces, [replace(edges[0], instances=(0, 1))])[0]
    _assert_same(far.region, far.unrefined)
    far = _extents(scene, surfaces, [replace(edges[0], instances=(0, 1))], ExtentConfig(min_angle_deg=4.0))[0]
    assert far.region.area == pytest.approx(10.0)


def _partition_room() -> tuple[rooms.Surface, ...]:
    """A partition half-way down the room, 1.5 m wide, with the far wall behind it."""
    return (rooms.FLOOR, rooms.FAR, rooms.Surface("wall", rooms.rectangle([1.0, 3.5, 0], [1.5, 0, 0], [0, 0, 2.0])))


@pytest.mark.parametrize("bad", [0, 2])
def test_one_bad_key_frame_of_five_is_outvoted(bad: int) -> None:
    """A slip of the hand widens the partition in one frame; the others see the far wall there, behind it."""
    surfaces = _partition_room()
    cameras = [rooms.level_camera((x, 1.0, MIDDLE[2])) for x in (1.6, 1.8, 2.0, 2.2, 2.4)]
    far_drawn = [rooms.draw(rooms.FAR.corners, c).difference(rooms.draw(surfaces[2].corners, c)) for c in cameras]
    scene = rooms.seen_from(cameras, surfaces)
    for k, drawn in enumerate(far_drawn):
        scene = rooms.redraw(scene, k, 1, polygons(drawn))
    widened = rooms.rectangle([1.0, 3.5, 0], [2.2, 0, 0], [0, 0, 2.0])
    slipped = rooms.redraw(scene, bad, 2, rooms.draw(widened, cameras[bad]))
    partition, good = (_extents(s, surfaces)[2] for s in (slipped, scene))
    _assert_same(_world_polygon(good, (0, 2)), box(1.0, 0, 2.5, 2.0))
    _assert_same(_world_polygon(partition, (0, 2)), box(1.0, 0, 2.5, 2.0))


def test_part_that_one_frame_sees_outlives_votes_against_its_neighbourhood() -> None:
    """One frame draws the floor from y = 3 on; two nearer ones see it from y = 4 on, the far wall from y = 4.5 on."""
    cameras = [rooms.level_camera((x, y, MIDDLE[2])) for x, y in ((2.0, 1.0), (1.0, 2.0), (1.0, 2.0))]
    surfaces = (rooms.FLOOR, rooms.FAR)
    scene = rooms.seen_from(cameras, surfaces)
    shorter = rooms.rectangle([0, 0, 0], rooms.X, [0, 4.5, 0])
    for k in (1, 2):
        floor_px = rooms.draw(shorter, cameras[k])
        scene = rooms.redraw(scene, k, 0, floor_px)
        scene = rooms.redraw(scene, k, 1, polygons(box(0, 0, 160, 100).difference(floor_px)))
    contradicted = Polygon([(0, 4.5), (3.5, 4.5), (4, 5), (0, 5)])
    floor = _extents(scene, surfaces)[0]
    _assert_same(_world_polygon(floor, (0, 1)), polygons(box(0, 3, 4, 5).difference(contradicted)))


@pytest.mark.parametrize("slip_m", [-0.02, 0.02], ids=["short of the pillar", "into the pillar"])
@pytest.mark.parametrize(("front_m", "face"), [(3.5, "side"), (3.15, "front")])
def test_floor_goes_on_past_a_pillar(front_m: float, face: str, slip_m: float) -> None:
    """A pillar stands at x < 1, y > front_m. What the floor has on the far side of a face's plane is floor too.

    Beside the side's plane lie 7.7 % of the floor, before the front's 9.8 %: less than what may be cut, and in the
    second case less than what lies behind the plane.
    """
    surface = rooms.Surface(
        "wall",
        rooms.rectangle([1, 5, 0], [0, front_m - 5, 0], rooms.Z)[[0, 3, 2, 1]]
        if face == "side"
        else rooms.rectangle([0, front_m, 0], [1, 0, 0], rooms.Z),
    )
    camera = rooms.level_camera(MIDDLE)
    whole, pillar = rooms.draw(rooms.FLOOR.corners, camera), box(0, front_m, 1, 5)
    drawn = box(0, front_m, 1 - slip_m, 5) if face == "side" else box(0, front_m + slip_m, 1, 5)
    corners = np.column_stack([np.array(drawn.exterior.coords)[:-1], np.zeros(4)])
    scene = rooms.make_scene([camera], [[("floor", polygons(whole.difference(rooms.draw(corners, camera))))]])
    foot = np.linspace([1, front_m, 0], [1, 5, 0] if face == "side" else [0, front_m, 0], 20)
    foot += [-slip_m, 0, 0] if face == "side" else [0, slip_m, 0]
    edge = ContactEdge(0, (0, 1), camera.project(foot)[0])
    instances = (*rooms.instances_of((rooms.FLOOR,), 1), Instance("wall_0", "wall", ()))
    planes = [rooms.FLOOR.plane, surface.plane]
    floor = compute_extents(scene, instances, planes, [edge], ExtentConfig())[0]
    _assert_same(_world_polygon(floor, (0, 1)), polygons(box(0, 3, 4, 5).difference(pillar)), 1e-6)


def test_what_hides_an_element_does_not_vote_against_it() -> None:
    """Behind the partition the far wall goes on: one frame draws it through, four leave a hole."""
    surfaces = _partition_room()
    cameras = [rooms.level_camera((x, 1.0, MIDDLE[2])) for x in (1.6, 1.8, 2.0, 2.2, 2.4)]
    scene = rooms.seen_from(cameras, surfaces)
    for k in range(1, 5):
        seen = rooms.draw(rooms.FAR.corners, cameras[k]).difference(rooms.draw(surfaces[2].corners, cameras[k]))
        scene = rooms.redraw(scene, k, 1, polygons(seen))
    far = _extents(scene, surfaces)[1]
    assert far.region.area == pytest.approx(10.0)
    assert not far.region.geoms[0].interiors


@pytest.mark.parametrize("through", [False, True], ids=["tiled", "drawn on top"])
def test_wall_goes_on_behind_its_door(through: bool) -> None:
    """Whichever way it is drawn, the wall covers its door; the door keeps an extent of its own on its own plane."""
    recess = 0.1
    door = rooms.Surface("door", rooms.rectangle([1.5, 5 + recess, 0], [1.0, 0, 0], [0, 0, 2.0]), host=0)
    opening = rooms.Surface("door", rooms.rectangle([1.5, 5, 0], [1.0, 0, 0], [0, 0, 2.0]))
    camera = rooms.level_camera(MIDDLE)
    wall_px, leaf_px = rooms.draw(rooms.FAR.corners, camera), rooms.draw(opening.corners, camera)
    tiled = polygons(wall_px.difference(leaf_px))
    scene = rooms.make_scene([camera], [[("wall", wall_px if through else tiled), ("door", leaf_px)]])
    wall, leaf = _extents(scene, (rooms.FAR, door))
    _assert_same(_world_polygon(wall, (0, 2)), box(0, 0, 4, 2.5))
    scale = 4.1 / 4.0
    assert leaf.region.area == pytest.approx(2.0 * scale**2)
    np.testing.assert_allclose(leaf.frame.to_world(np.array(leaf.region.geoms[0].exterior.coords))[:, 1], 5 + recess)


def test_slivers_and_pinholes_are_dropped() -> None:
    """A slit of 0.1 px within the element and a crumb beside it; a hole of 1 m² in 30 m² is real."""
    drawn = rooms.pixels(10, 10, 70, 60).difference(rooms.pixels(30, 20, 30.1, 50)).union(rooms.pixels(80, 10, 81, 11))
    surface = rooms.facing(10, 10, 70, 60)
    scene = rooms.make_scene([rooms.facing_camera()], [[("wall", polygons(drawn))]])
    (extent,) = _extents(scene, [surface])
    assert len(extent.region.geoms) == 1
    assert extent.region.area == pytest.approx(6.0 * 5.0)
    real = rooms.make_scene(
        [rooms.facing_camera()], [[("wall", polygons(drawn.difference(rooms.pixels(40, 20, 50, 30))))]]
    )
    assert _extents(real, [surface])[0].region.area == pytest.approx(6.0 * 5.0 - 1.0)


@pytest.mark.parametrize(
    ("max_depth", "first_row"),
    [(np.inf, 60.0), (8.0, 50 + 80 * 1.25 / 8.0), (40.0, 60.0)],
    ids=["horizon", "depth", "horizon before depth"],
)
def test_clip_at_depth_and_horizon(max_depth: float, first_row: float) -> None:
    """Floor 1.25 m below a level camera: 1/z = (y − 50) / 100 per px, the horizon is row 50."""
    camera = rooms.level_camera(MIDDLE)
    image = box(0, 0, 160, 100)
    clipped = clip_to_plane(image, rooms.FLOOR.plane, camera, max_depth, min_horizon_px=10.0)
    _assert_same(clipped, box(0, first_row, 160, 100), 1e-6)
    points = unproject(np.array([[3.0, first_row], [160.0, 100.0]]), rooms.FLOOR.plane, camera)
    np.testing.assert_allclose(points[:, 2], 0, atol=1e-12)
    np.testing.assert_allclose(points[:, 1] - 1.0, 100 / (np.array([first_row, 100.0]) - 50))


def test_clip_of_planes_that_cannot_be_seen() -> None:
    image = box(0, 0, 160, 100)
    behind, inside = rooms.level_camera([2.0, 6.0, 1.25]), rooms.level_camera([2.0, 1.0, 0.0])
    assert clip_to_plane(image, rooms.FAR.plane, behind, np.inf, 10.0).is_empty
    assert clip_to_plane(image, rooms.FLOOR.plane, inside, np.inf, 10.0).is_empty
    assert clip_to_plane(MultiPolygon(), rooms.FAR.plane, inside, np.inf, 10.0).is_empty


def test_polygon_up_to_the_horizon_stays_finite() -> None:
    """The floor drawn up to row 50.01, where it is 10 km away: ten times the scene's median depth is the limit."""
    camera = rooms.level_camera(MIDDLE)
    scene = rooms.redraw(rooms.seen_from([camera], SEEN), 0, 0, rooms.pixels(40, 50.01, 120, 100))
    floor = _extents(scene, SEEN)[0]
    far_end = floor.frame.to_world(np.array(floor.region.geoms[0].exterior.coords))[:, 1].max()
    assert far_end - 1.0 == pytest.approx(10.0)


def test_unproject_undoes_project() -> None:
    rng = np.random.default_rng(0)
    uv = rng.uniform(0.5, 2.0, (20, 2))
    camera = rooms.level_camera(MIDDLE)
    points: FloatArray = rooms.FAR.extent.frame.to_world(uv)
    np.testing.assert_allclose(unproject(camera.project(points)[0], rooms.FAR.plane, camera), points, atol=1e-12)


@pytest.mark.parametrize("cap_style", ["round", "flat"])
def test_fine_lines_are_buffered_in_runs_to_the_same_region(cap_style: Literal["round", "flat"]) -> None:
    """Zigzags of 400 vertices, which are split, and of 200, which are not."""
    fine, coarse = (np.linspace(0, 10, count) for count in (400, 200))
    apart = [np.column_stack([x, y + 0.01 * np.sin(20 * x)]) for x, y in ((fine, 0.0), (coarse, 3.0))]
    lines = MultiLineString(apart)
    whole = shapely.buffer(lines, 0.5, cap_style=cap_style)
    assert buffered(lines, 0.5, cap_style).symmetric_difference(whole).area < 2e-3 * whole.area
    assert buffered(LineString(apart[1]), 0.5, cap_style).equals_exact(
        LineString(apart[1]).buffer(0.5, cap_style=cap_style)
    )


def test_many_lines_are_buffered_as_one_region() -> None:
    """As contact edges are: many short pieces of nearly one line, with flat ends, of which GEOS loses slivers."""
    rng = np.random.default_rng(0)
    pieces = [LineString([[x, 0.01 * rng.normal()], [x + 0.3, 0.01 * rng.normal()]]) for x in np.arange(0, 9, 0.3)]
    region = buffered(shapely.union_all(pieces), 2.0, "flat", 4)
    each = [piece.buffer(2.0, cap_style="flat") for piece in pieces]
    assert region.is_valid
    assert all(region.buffer(1e-9).covers(piece) for piece in each)
    assert region.area == pytest.approx(shapely.union_all(each).area)


@pytest.mark.parametrize(("offset", "left"), [(0.0, 4.0), (-1.0, 2.0), (-2.0, 0.0), (0.1, 4.0), (-3.0, 0.0)])
def test_cut_leaves_the_side_with_positive_values(offset: float, left: float) -> None:
    square = shapely.box(0.0, 5.0, 2.0, 7.0)
    part = cut(square, np.array([1.0, 0.0, offset]))
    assert part.area == pytest.approx(left)
    assert part.is_empty or part.bounds[2] == 2.0


def test_finely_drawn_outlines_give_the_extents_of_plain_ones() -> None:
    """Some 500 vertices an outline, each on a ripple of 0.2 px that all key frames draw elsewhere."""
    cameras = [rooms.level_camera((x, 1.0, MIDDLE[2])) for x in (1.8, 1.9, 2.1, 2.2)]
    plain = fine = rooms.seen_from(cameras, SEEN)
    for k, key_frame in enumerate(plain.key_frames):
        for e, element in enumerate(key_frame.elements):
            finely = shapely.segmentize(element.amodal, element.amodal.length / 500)
            rippled = shapely.transform(finely, lambda xy: xy + 0.2 * np.sin(2 * xy[:, ::-1] + k))  # noqa: B023
            fine = rooms.redraw(fine, k, e, polygons(rippled))
    instances = rooms.instances_of(SEEN, len(cameras))
    for one, other in zip(
        *(_extents(scene, SEEN, contact_edges(scene, instances, EdgeConfig())) for scene in (plain, fine)), strict=True
    ):
        assert one.region.symmetric_difference(other.region).area < 0.02 * one.region.area
