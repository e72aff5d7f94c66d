"""Filling, rendering: coverage and depth in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import rooms
import shapely
from shapely import MultiPolygon, Polygon, box

from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.raster import annotated_labels, fill, rings_of
from gtlayout.geometry.render import project_rings, render
from gtlayout.instances import Extent
from gtlayout.scene import BoolArray, Camera, FloatArray


def _centres(height: int, width: int) -> FloatArray:
    rows, columns = np.mgrid[:height, :width]
    return np.column_stack([columns.ravel() + 0.5, rows.ravel() + 0.5])


def _contains(region: MultiPolygon, height: int, width: int) -> BoolArray:
    centres = _centres(height, width)
    inside: BoolArray = shapely.contains_xy(region, centres[:, 0], centres[:, 1]).reshape(height, width)
    return inside


def _render(camera: Camera, *surfaces: rooms.Surface) -> tuple[FloatArray, FloatArray]:
    labels, depth = render(
        [s.plane for s in surfaces], [s.extent for s in surfaces], rooms.instances_of(surfaces, 1), camera
    )
    assert labels.dtype == np.int32
    assert depth.dtype == np.float32
    return labels.astype(float), depth.astype(float)


def test_fill_takes_the_pixels_whose_centre_lies_inside() -> None:
    covered = fill([np.array([[1.4, 0.6], [3.4, 0.6], [3.4, 2.6], [1.4, 2.6]])], 4, 6)
    expected = np.zeros((4, 6), dtype=bool)
    expected[1:3, 1:3] = True
    np.testing.assert_array_equal(covered, expected)


@pytest.mark.parametrize("seed", range(5))
def test_fill_is_what_shapely_contains(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 15))
    star = np.column_stack([np.cos(angle), np.sin(angle)]) * rng.uniform(8, 40, 15)[:, None]
    # Reaches beyond all four borders and has a hole.
    region = MultiPolygon([Polygon(star + np.array([25, 20]))]).difference(box(18.3, 15.2, 29.7, 24.9))
    region = MultiPolygon([part for part in shapely.get_parts(region) if part.area > 0])
    np.testing.assert_array_equal(fill(rings_of(region), 40, 50), _contains(region, 40, 50))


def test_neighbours_tile_without_gap_or_overlap() -> None:
    """Centres on the common line (x = 10.5, a slant through centres) belong to exactly one side."""
    quads = [[(0, 0), (10.5, 0), (10.5, 12), (0, 12)], [(10.5, 0), (20, 0), (20, 12), (10.5, 12)]]
    triangles = [[(0, 0), (20, 0), (20, 20)], [(0, 0), (20, 20), (0, 20)]]
    for parts, size in ((quads, (12, 20)), (triangles, (20, 20))):
        count = sum(fill([np.array(part, dtype=float)], *size).astype(int) for part in parts)
        np.testing.assert_array_equal(count, np.ones(size))


def test_fill_of_nothing_and_of_what_lies_outside() -> None:
    assert not fill([], 3, 4).any()
    assert not fill([np.array([[-9.0, -9], [-1, -9], [-1, -1]])], 3, 4).any()
    assert fill([np.array([[-1e7, -1e7], [1e7, -1e7], [1e7, 1e7], [-1e7, 1e7]])], 3, 4).all()


def test_annotated_openings_lie_on_their_walls_in_whatever_order() -> None:
    door, wall = rooms.facing(40, 30, 50, 60, "door", host=1), rooms.facing(20, 20, 60, 60)
    scene = rooms.seen_from([rooms.facing_camera()], [door, wall])
    labels = annotated_labels(scene, rooms.instances_of([door, wall], 1), 0)
    assert [np.count_nonzero(labels == i) for i in (0, 1)] == [10 * 30, 40 * 40 - 10 * 30]
    assert labels[30, 40] == 0
    assert labels[29, 40] == 1
    assert labels[19, 20] == -1


def test_facing_wall_covers_its_pixels_at_its_depth() -> None:
    labels, depth = _render(rooms.facing_camera(), rooms.facing(20, 30, 60, 70))
    np.testing.assert_array_equal(labels == 0, _contains(rooms.pixels(20, 30, 60, 70), 80, 100))
    np.testing.assert_allclose(depth[labels == 0], rooms.WALL_DEPTH, rtol=1e-6)
    assert np.isnan(depth[labels < 0]).all()


def test_box_room_from_inside_is_closed_and_has_the_depth_of_the_box() -> None:
    """Every surface reaches behind the camera but the far wall: the near plane must cut, not fold, their outlines."""
    centre = np.array([1.3171, 1.7, 1.1093])
    camera = rooms.level_camera(centre, focal=30.0)
    labels, depth = _render(camera, *rooms.BOX)
    assert (labels >= 0).all()
    rays = camera.rays_world(_centres(camera.height, camera.width))
    with np.errstate(divide="ignore"):
        reach = np.where(rays > 0, np.array([rooms.WIDTH_M, rooms.DEPTH_M, rooms.HEIGHT_M]) - centre, -centre) / rays
    np.testing.assert_allclose(depth.ravel(), reach.min(axis=1), rtol=1e-5)
    # (axis hit, positive side?) → index in BOX
    index = np.array([[2, 3], [5, 4], [0, 1]])
    axis = reach.argmin(axis=1)
    expected = index[axis, (np.take_along_axis(rays, axis[:, None], axis=1)[:, 0] > 0).astype(int)]
    np.testing.assert_array_equal(labels.ravel(), expected)


def test_floor_under_the_camera_ends_at_the_far_wall_line() -> None:
    """The floor alone, from y = 0 behind the camera to y = 5: 1/z = (row − 50) / (80 · 1.25)."""
    camera = rooms.level_camera([2.0, 1.0, 1.25])
    labels, depth = _render(camera, rooms.FLOOR)
    rows = np.arange(100) + 0.5
    expected = 80 * 1.25 / (rows - 50)
    in_floor = (rows > 50) & (expected < 4)
    np.testing.assert_array_equal((labels == 0)[:, 80], in_floor)
    np.testing.assert_allclose(depth[in_floor, 80], expected[in_floor], rtol=1e-5)


def test_what_lies_behind_the_camera_is_not_drawn() -> None:
    behind = rooms.level_camera([2.0, 6.0, 1.25])
    assert project_rings(rooms.FAR.extent, behind) == []
    labels, depth = _render(behind, *rooms.BOX)
    assert (labels == -1).all()
    assert np.isnan(depth).all()


def test_camera_in_the_plane_sees_nothing_of_it() -> None:
    labels, _ = _render(rooms.level_camera([2.0, 1.0, 0.0]), rooms.FLOOR)
    assert (labels == -1).all()


def test_nearer_surface_wins_in_whatever_order() -> None:
    wall = rooms.facing(20, 20, 80, 60)
    nearer = rooms.Surface("wall", rooms.facing(30, 30, 50, 50).corners * 0.5)
    for surfaces, index in (((wall, nearer), 1), ((nearer, wall), 0)):
        labels, depth = _render(rooms.facing_camera(), *surfaces)
        assert np.count_nonzero(labels == index) == 20 * 20
        np.testing.assert_allclose(depth[labels == index], rooms.WALL_DEPTH / 2, rtol=1e-6)


def test_opening_wins_over_its_host_and_over_nothing_else() -> None:
    """The door sits back in its wall by 0.1 m; a partition in front of both hides half of it."""
    wall = rooms.facing(20, 20, 80, 60)
    door = rooms.Surface("door", rooms.facing(40, 30, 60, 60).corners * 1.01, host=0)
    partition = rooms.Surface("wall", rooms.facing(50, 0, 100, 80).corners * 0.5)
    labels, depth = _render(rooms.facing_camera(), wall, door, partition)
    assert np.count_nonzero(labels == 1) == 10 * 30
    np.testing.assert_allclose(depth[labels == 1], rooms.WALL_DEPTH * 1.01, rtol=1e-6)
    labels, _ = _render(rooms.facing_camera(), wall, replace(door, host=None), partition)
    assert np.count_nonzero(labels == 1) == 0


def test_hole_shows_what_is_behind() -> None:
    front, back = rooms.facing(20, 20, 60, 60), rooms.Surface("wall", rooms.facing(0, 0, 100, 80).corners * 2)
    frame, region = front.extent.frame, front.extent.region
    pierced = MultiPolygon([Polygon(region.geoms[0].exterior, [box(1, 1, 2, 3).exterior.coords])])
    planes, extents = [front.plane, back.plane], [Extent(frame, pierced, pierced), back.extent]
    labels, depth = render(planes, extents, rooms.instances_of([front, back], 1), rooms.facing_camera())
    # Frame origin: the wall's lower left corner, pixel (20, 60); 10 px a metre.
    np.testing.assert_array_equal(labels[30:50, 30:40], 1)
    assert np.count_nonzero(labels == 0) == 40 * 40 - 10 * 20
    np.testing.assert_allclose(depth[30:50, 30:40], 2 * rooms.WALL_DEPTH, rtol=1e-6)


def test_inverse_depth_of_a_turned_camera() -> None:
    """Against the definition: the point at depth 1 / (a x + b y + c) lies on the plane."""
    turn = np.array([[np.cos(0.3), 0, np.sin(0.3)], [0, 1, 0], [-np.sin(0.3), 0, np.cos(0.3)]])
    level = rooms.level_camera([2.0, 1.0, 1.25])
    camera = replace(level, R_cam_from_world=turn @ level.R_cam_from_world, t_cam_from_world=np.array([0.4, 0.2, -0.7]))
    points_px = np.array([[3.0, 5], [150, 20], [77, 99]])
    for surface in rooms.BOX:
        depth = 1 / (np.column_stack([points_px, np.ones(3)]) @ inverse_depth(surface.plane, camera))
        points = camera.center_world + depth[:, None] * camera.rays_world(points_px)
        np.testing.assert_allclose(points @ surface.plane.normal, -surface.plane.d, atol=1e-9)
