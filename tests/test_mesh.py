"""Stage 6: triangles that tile the extents and share their vertices where elements touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import rooms
import shapely
import trimesh
from shapely import MultiPolygon, Polygon, box

from gtlayout.edges import EdgeConfig, contact_edges
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.extents import compute_extents
from gtlayout.instances import Extent, Mesh, Plane
from gtlayout.mesh import build_mesh, vertex_sigma
from gtlayout.scene import FloatArray

WIDTH, DEPTH, HEIGHT = rooms.WIDTH_M, rooms.DEPTH_M, rooms.HEIGHT_M


def _mesh(surfaces: Sequence[rooms.Surface]) -> Mesh:
    return build_mesh(rooms.instances_of(surfaces, 1), [surface.extent for surface in surfaces])


def _surface(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def _areas(mesh: Mesh, instances: int) -> FloatArray:
    """(instances,) area of each."""
    return np.array([_surface(mesh).area_faces[mesh.face_instance == i].sum() for i in range(instances)])


def test_box_room_is_watertight_with_eight_vertices() -> None:
    mesh = _mesh(rooms.BOX)
    surface = _surface(mesh)
    assert surface.is_watertight
    assert surface.is_winding_consistent
    assert len(mesh.vertices) == 8
    assert len(mesh.faces) == 12
    # Counter-clockwise seen from within, so the volume is negative.
    assert surface.volume == pytest.approx(-WIDTH * DEPTH * HEIGHT)
    expected = [WIDTH * DEPTH] * 2 + [DEPTH * HEIGHT] * 2 + [WIDTH * HEIGHT] * 2
    np.testing.assert_allclose(_areas(mesh, 6), expected)


def test_faces_are_counter_clockwise_seen_from_the_cameras() -> None:
    mesh = _mesh(rooms.BOX)
    normals = np.stack([surface.plane.normal for surface in rooms.BOX])
    np.testing.assert_allclose(_surface(mesh).face_normals, normals[mesh.face_instance], atol=1e-12)


def test_a_wall_in_two_pieces_shares_its_middle_vertices_with_its_neighbours() -> None:
    """A corner in the middle of the neighbour's edge: without a vertex there the mesh would have a T-junction."""
    halves = tuple(
        rooms.Surface("wall", rooms.rectangle([x, DEPTH, 0], [w, 0, 0], rooms.Z)) for x, w in ((0, 1.3), (1.3, 2.7))
    )
    surfaces = (rooms.FLOOR, rooms.CEILING, rooms.LEFT, rooms.RIGHT, rooms.NEAR, *halves)
    mesh = _mesh(surfaces)
    assert len(mesh.vertices) == 10
    assert _surface(mesh).is_watertight
    np.testing.assert_allclose(_areas(mesh, 7)[[0, 5, 6]], [WIDTH * DEPTH, 1.3 * HEIGHT, 2.7 * HEIGHT])


def test_neighbours_that_miss_each_other_by_millimetres_are_welded() -> None:
    """The layout's diagonal is 6.9 m, of which a thousandth is one."""
    moved = rooms.Surface("wall", rooms.FAR.corners + np.array([0.002, 0.001, 0.002]))
    mesh = _mesh((*rooms.BOX[:4], moved, rooms.NEAR))
    assert len(mesh.vertices) == 8
    assert _surface(mesh).is_watertight
    apart = _mesh((*rooms.BOX[:4], replace(moved, corners=rooms.FAR.corners + np.array([0, 0.05, 0])), rooms.NEAR))
    assert len(apart.vertices) == 12
    assert not _surface(apart).is_watertight


def test_a_crumb_pinched_to_a_line_does_not_take_the_other_pieces_with_it() -> None:
    """A triangle of a millimetre beside two pieces of floor: its corners snap onto the foot of a tiny wall."""
    crumb = Polygon([(2, 1), (2.002, 1), (2.001, 1.001)])
    floor = replace(rooms.FLOOR.extent, region=MultiPolygon([box(0, 0, 1, 2), box(3, 0, 4, 2), crumb]))
    wall = rooms.Surface("wall", rooms.rectangle([1.999, 1.001, 0], [0.004, 0, 0], rooms.Z))
    mesh = build_mesh(rooms.instances_of((rooms.FLOOR, wall), 1), [floor, wall.extent])
    assert _areas(mesh, 1) == pytest.approx([4.0])


def test_contact_edges_share_vertices_after_refinement() -> None:
    """The far wall drawn 2 % too narrow: refinement closes the gap, the mesh joins the walls on the common line."""
    surfaces = (rooms.FLOOR, rooms.CEILING, rooms.LEFT, rooms.RIGHT, rooms.FAR)
    camera = rooms.level_camera([2.0, 1.0, 1.25])
    narrow = rooms.draw(rooms.rectangle([0.08, DEPTH, 0], [WIDTH - 0.08, 0, 0], rooms.Z), camera)
    scene = rooms.redraw(rooms.seen_from([camera], surfaces), 0, 4, narrow)
    instances, planes = rooms.instances_of(surfaces, 1), [surface.plane for surface in surfaces]
    edges = contact_edges(scene, instances, EdgeConfig())
    mesh = build_mesh(instances, compute_extents(scene, instances, planes, edges, ExtentConfig()))
    shared = np.intersect1d(mesh.faces[mesh.face_instance == 2], mesh.faces[mesh.face_instance == 4])
    corner = mesh.vertices[shared]
    np.testing.assert_allclose(corner[np.argsort(corner[:, 2])], [[0, DEPTH, 0], [0, DEPTH, HEIGHT]], atol=1e-6)
    # Open only towards the camera.
    edges_of_faces = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    pairs, count = np.unique(edges_of_faces, axis=0, return_counts=True)
    np.testing.assert_allclose(mesh.vertices[pairs[count == 1]][:, :, 1], 3.0, atol=1e-6)


@pytest.mark.parametrize("recess", [0.0, 0.1])
def test_a_door_is_cut_out_of_its_wall(recess: float) -> None:
    door = rooms.Surface("door", rooms.rectangle([1.5, DEPTH + recess, 0], [1.0, 0, 0], [0, 0, 2.0]), host=0)
    mesh = _mesh((rooms.FAR, door))
    np.testing.assert_allclose(_areas(mesh, 2), [WIDTH * HEIGHT - 2.0, 2.0])
    joined = np.intersect1d(mesh.faces[mesh.face_instance == 0], mesh.faces[mesh.face_instance == 1])
    assert len(joined) == (4 if recess == 0 else 0)
    # Without a host it is a panel in front of the wall, and cuts nothing.
    np.testing.assert_allclose(_areas(_mesh((rooms.FAR, replace(door, host=None))), 2), [WIDTH * HEIGHT, 2.0])


def test_a_window_leaves_a_hole_that_stays_open() -> None:
    """Triangulation with a hole: no triangle may lie in it."""
    extent = rooms.FAR.extent
    pierced = MultiPolygon([Polygon(extent.region.geoms[0].exterior, [box(1.0, 0.8, 2.5, 2.0).exterior.coords])])
    mesh = build_mesh(rooms.instances_of([rooms.FAR], 1), [Extent(extent.frame, pierced, pierced)])
    assert _surface(mesh).area == pytest.approx(WIDTH * HEIGHT - 1.5 * 1.2)
    centres = extent.frame.to_plane(_surface(mesh).triangles_center)
    assert not ((centres > [1.0, 0.8]) & (centres < [2.5, 2.0])).all(axis=1).any()


def test_separate_pieces_stay_separate() -> None:
    extent = rooms.FAR.extent
    parts = MultiPolygon([box(0, 0, 1, 2.5), box(2, 0, 4, 2.5)])
    mesh = build_mesh(rooms.instances_of([rooms.FAR], 1), [Extent(extent.frame, parts, parts)])
    assert _surface(mesh).area == pytest.approx(7.5)
    assert len(_surface(mesh).split(only_watertight=False)) == 2


def test_nothing_to_draw_is_an_empty_mesh() -> None:
    empty = Extent(rooms.FAR.extent.frame, rooms.NOTHING, rooms.NOTHING)
    for mesh in (build_mesh((), ()), build_mesh(rooms.instances_of([rooms.FAR], 1), [empty])):
        assert mesh.vertices.shape == (0, 3)
        assert mesh.faces.shape == (0, 3)
        assert mesh.face_instance.shape == (0,)
    mesh = build_mesh(rooms.instances_of([rooms.FAR, rooms.LEFT], 1), [empty, rooms.LEFT.extent])
    np.testing.assert_allclose(_areas(mesh, 2), [0.0, DEPTH * HEIGHT])


def test_same_extents_same_mesh() -> None:
    first, second = _mesh(rooms.BOX), _mesh(rooms.BOX)
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)


def test_a_finely_drawn_outline_keeps_its_area() -> None:
    """A round window of 2,000 corners, each within welding distance of the next."""
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    outline = Polygon(np.column_stack([2 + np.cos(angle), 1 + 0.5 * np.sin(angle)]))
    floor = replace(rooms.FLOOR.extent, region=MultiPolygon([outline]))
    mesh = build_mesh(rooms.instances_of((rooms.FLOOR,), 1), [floor])
    assert _areas(mesh, 1) == pytest.approx([outline.area], rel=1e-6)


@pytest.mark.parametrize("step_m", [0.012, 0.003])
def test_fine_outlines_side_by_side_keep_their_areas_and_share_vertices(step_m: float) -> None:
    """Each side of the box room with a vertex every few millimetres, half a step off those of its neighbours."""
    extents = []
    for i, surface in enumerate(rooms.BOX):
        corners = shapely.get_coordinates(surface.extent.region)[:-1]
        sides = np.roll(corners, -1, axis=0) - corners
        outline = [
            corner
            + np.append(0.0, np.arange(step_m * (0.5 + i % 2 / 2), length - 1e-3, step_m))[:, None] * side / length
            for corner, side, length in zip(corners, sides, np.linalg.norm(sides, axis=1), strict=True)
        ]
        extents.append(replace(surface.extent, region=MultiPolygon([Polygon(np.concatenate(outline))])))
    mesh = build_mesh(rooms.instances_of(rooms.BOX, 1), extents)
    expected = [WIDTH * DEPTH] * 2 + [DEPTH * HEIGHT] * 2 + [WIDTH * HEIGHT] * 2
    np.testing.assert_allclose(_areas(mesh, 6), expected, rtol=5e-4)
    assert _surface(mesh).is_watertight


def test_sigma_of_vertices_by_hand() -> None:
    """The floor's height known to 1 cm and its tilt about the x axis to 2°, the left wall's offset to 3 cm."""
    mesh = _mesh((rooms.FLOOR, rooms.LEFT))
    floor = replace(rooms.FLOOR.plane, covariance=np.diag([0, np.deg2rad(2.0) ** 2, 0, 0.01**2]))
    wall = replace(rooms.LEFT.plane, covariance=np.diag([0, 0, 0, 0.03**2]))
    extents = [rooms.FLOOR.extent, rooms.LEFT.extent]
    by_place = {
        tuple(vertex.round(6)): sigma
        for vertex, sigma in zip(mesh.vertices, vertex_sigma(mesh, [floor, wall], extents), strict=True)
    }
    far = np.hypot(0.01, DEPTH * np.deg2rad(2.0))
    assert by_place == pytest.approx(
        {
            (WIDTH, 0, 0): 0.01,
            (WIDTH, DEPTH, 0): far,
            (0, 0, 0): 0.03,
            (0, DEPTH, 0): max(far, 0.03),
            (0, 0, HEIGHT): 0.03,
            (0, DEPTH, HEIGHT): 0.03,
        }
    )


def test_a_vertex_that_nothing_uses_has_no_sigma() -> None:
    mesh = Mesh(np.eye(4, 3), np.array([[0, 1, 2]]), np.array([0]))
    plane = Plane(np.ones(3) / np.sqrt(3), -1 / np.sqrt(3), np.diag([0, 0, 0, 4.0]), observable=True)
    extents = [rooms.FAR.extent]
    np.testing.assert_allclose(vertex_sigma(mesh, [plane], extents), [2.0, 2.0, 2.0, np.nan])
    assert vertex_sigma(Mesh.empty(), [plane], extents).shape == (0,)
