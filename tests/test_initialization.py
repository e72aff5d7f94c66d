"""Starting planes: near the truth, also where an element's own tracks are few or wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gtlayout.edges import ContactEdge
from gtlayout.planes import initialization
from gtlayout.planes.config import EstimationConfig, InitializationConfig
from gtlayout.planes.evidence import Evidence, gather
from gtlayout.planes.initialization import face_cameras, initial_planes
from gtlayout.planes.views import Views
from gtlayout.scene import FloatArray
from gtlayout.tracking.config import TriangulationConfig
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import triangulate
from simulated.simulated_edges import true_edges
from simulated.simulated_room import Room, box_faces, make_room, orbit
from simulated.simulation import chosen, make_tracks, measurements, true_instance

KEY_FRAMES = [2, 6, 10, 14, 18]
CONFIG = EstimationConfig()


@pytest.fixture(scope="module")
def room() -> Room:
    return make_room(orbit(), KEY_FRAMES)


def collect(room: Room, tracks: Tracks, edges: Sequence[ContactEdge]) -> tuple[Evidence, Normalisation]:
    measured = measurements(room, tracks, edges)
    local = Normalisation.of(measured.rays)
    return gather(measured, local, CONFIG), local


def start(room: Room, tracks: Tracks, edges: Sequence[ContactEdge], seed: int = 0) -> FloatArray:
    """(S, 4) starting planes in the world."""
    evidence, local = collect(room, tracks, edges)
    return local.planes_to_world(initial_planes(evidence, CONFIG.depth_range, CONFIG.initialization, seed))[0]


def off(room: Room, planes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angles in degrees and distances of the seen centres."""
    cosine = np.clip(np.sum(planes[:, :3] * room.planes[:, :3], axis=1), -1, 1)
    centers = np.array([room.seen_center(i) for i in range(len(planes))])
    return np.rad2deg(np.arccos(cosine)), np.abs(np.sum(planes[:, :3] * centers, axis=1) + planes[:, 3])


@pytest.mark.parametrize("seed", range(3))
def test_the_start_is_in_the_right_basin(room: Room, seed: int) -> None:
    tracks = make_tracks(room, np.random.default_rng(seed), sigma_px=1.0, drifting=0.2)
    angles_deg, offsets = off(room, start(room, tracks, true_edges(room), seed))
    assert angles_deg.max() < 5
    assert offsets.max() < 0.15


def test_tracks_alone_are_enough(room: Room) -> None:
    angles_deg, offsets = off(room, start(room, make_tracks(room, np.random.default_rng(0)), []))
    assert angles_deg.max() < 5
    assert offsets.max() < 0.15


def test_edges_outvote_a_few_mirror_images(room: Room) -> None:
    # A glossy wall: its few tracks triangulate consistently on a plane 1 m behind it.
    wall = next(i for i, plane in enumerate(room.planes) if plane[1] < -0.9)
    mirror = replace(room, planes=room.planes.copy())
    mirror.planes[wall, 3] += 1.0
    rng = np.random.default_rng(0)
    good = make_tracks(room, rng)
    bad = make_tracks(mirror, rng, without=[i for i in range(len(room.instances)) if i != wall])
    few = np.nonzero(true_instance(room, bad) == wall)[0][:10]
    keep = np.nonzero(true_instance(room, good) != wall)[0]
    tracks = joined(chosen(good, keep), chosen(bad, few))
    angles_deg, offsets = off(room, start(room, tracks, true_edges(room)))
    assert offsets[wall] < 0.15
    assert angles_deg[wall] < 5


def test_what_nothing_places_is_nan_and_the_rest_is_not(room: Room) -> None:
    wall = next(i for i, plane in enumerate(room.planes) if plane[1] < -0.9)
    edges = [edge for edge in true_edges(room) if wall not in edge.instances]
    planes = start(room, make_tracks(room, np.random.default_rng(0), without=[wall]), edges)
    assert np.isnan(planes[wall]).all()
    assert np.isfinite(np.delete(planes, wall, axis=0)).all()


@pytest.mark.parametrize("neighbour", ["floor", "wall"])
def test_edges_with_one_neighbour_do_not_put_a_surface_into_that_neighbours_plane(neighbour: str) -> None:
    # All these edges lie in the neighbour's plane, and two equal planes meet wherever one likes.
    faces = list(box_faces())
    faces[5] = replace(faces[5], label="slanted")
    room = make_room(orbit(), KEY_FRAMES, faces)
    slanted = room.index("slanted")
    other = room.index("floor") if neighbour == "floor" else room.index("wall")
    edges = [edge for edge in true_edges(room) if slanted not in edge.instances or other in edge.instances]
    planes = start(room, make_tracks(room, np.random.default_rng(0), without=[slanted]), edges)
    if np.isfinite(planes[slanted]).all():
        cosine = abs(planes[slanted, :3] @ planes[other, :3])
        assert cosine < np.cos(np.deg2rad(10))


def test_a_door_starts_on_its_wall() -> None:
    corners = np.array([[2.0, 5, 0], [2.0, 5, 2], [2.9, 5, 2], [2.9, 5, 0]])
    room = make_room(orbit(), KEY_FRAMES, [*box_faces(), replace(box_faces()[5], label="door", corners=corners)])
    door = room.index("door")
    wall = next(i for i, plane in enumerate(room.planes) if plane[1] < -0.9 and i != door)
    instances = tuple(replace(one, host=wall if i == door else None) for i, one in enumerate(room.instances))
    planes = start(replace(room, instances=instances), make_tracks(room, np.random.default_rng(0), without=[door]), [])
    np.testing.assert_array_equal(planes[door], planes[wall])


def test_normals_are_turned_to_the_cameras() -> None:
    views = Views(np.array([[0.0, 0, 1], [1, 0, 1.2]]), np.array([[0.0, 0, -1], [0, 0, -1]]))
    planes = np.array([[0.0, 0, 1, 0], [0, 0, -1, 0], [0, 0, 1, -3]])
    np.testing.assert_array_equal(face_cameras(planes, views), [[0, 0, 1, 0], [0, 0, 1, 0], [0, 0, -1, 3]])


def test_the_same_seed_gives_the_same_start(room: Room) -> None:
    tracks = make_tracks(room, np.random.default_rng(0), drifting=0.2)
    a, b = (start(room, tracks, true_edges(room)) for _ in range(2))
    assert a.tobytes() == b.tobytes()


def test_normalisation_keeps_pixels_and_planes() -> None:
    shift = np.array([1000.0, -1000.0, 1000.0])
    room = make_room(orbit(), KEY_FRAMES, scale=137.0, shift=shift, metric=False)
    rays = triangulate(room.scene, make_tracks(room, np.random.default_rng(0)), TriangulationConfig())
    local = Normalisation.of(rays)
    points = rays.points_world()
    inside = local.rays(rays).points_world()
    assert np.median(1 / local.rays(rays).rho) == pytest.approx(2.5, rel=0.01)
    np.testing.assert_allclose(np.median(inside, axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(local.points_to_world(inside), points, rtol=1e-9)
    camera = room.scene.frames[7].camera
    np.testing.assert_allclose(local.camera(camera).project(inside)[0], camera.project(points)[0], atol=1e-6)
    # A plane through three local points passes through the same three in the world.
    a, b, c = inside[:3]
    normal = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
    world, jacobian = local.planes_to_world(np.append(normal, -normal @ a)[None])
    np.testing.assert_allclose(points[:3] @ world[0, :3] + world[0, 3], 0, atol=1e-8)
    np.testing.assert_allclose(jacobian @ np.append(normal, -normal @ a), world[0], rtol=1e-12)


def joined(a: Tracks, b: Tracks) -> Tracks:
    """The tracks of both; tried points as in the first."""
    return Tracks(
        np.concatenate([a.key_frame, b.key_frame]),
        np.concatenate([a.element, b.element]),
        np.concatenate([a.track, b.track + len(a)]),
        np.concatenate([a.frame, b.frame]),
        np.concatenate([a.points_px, b.points_px]),
        np.concatenate([a.sigma_px, b.sigma_px]),
        a.tried,
    )


def test_of_many_tracks_so_many_take_part(room: Room) -> None:
    evidence, _ = collect(room, make_tracks(room, np.random.default_rng(0)), true_edges(room))
    own = np.nonzero(evidence.track_instance == 2)[0]
    for most in (1, 7, len(own) - 1, len(own), len(own) + 1):
        search = initialization._Search(
            evidence, (0.1, 30.0), replace(InitializationConfig(), max_tracks=most), np.random.default_rng(0)
        )
        part = search._take_part(2)
        assert len(part) <= most
        assert set(part) <= set(own)
        assert len(part) == len(own) or most < len(own)
        assert len(part) > most / 2 - 1


def cost(room: Room, evidence: Evidence, hypothesis: FloatArray, planes: FloatArray, **weights: Any) -> float:
    """Of the wall 0 at a hypothesis, with only these weights of the costs."""
    none: dict[str, Any] = dict.fromkeys(
        ("edge_weight", "perpendicularity_weight", "manhattan_weight", "max_track_weight"), 0.0
    )
    config = replace(InitializationConfig(), **{**none, "usual_depth_weight": 0.0, "absurd_weight": 0.0, **weights})
    search = initialization._Search(evidence, (0.15, 30.0), config, np.random.default_rng(0))
    index = search._take_part(0)
    return float(search._cost(0, index, hypothesis[None], planes)[0])


def local_planes(room: Room, local: Normalisation) -> FloatArray:
    planes = room.planes.copy()
    planes[:, 3] = local.scale * (planes[:, 3] + planes[:, :3] @ local.origin)
    return planes


def test_every_cost_is_what_it_says(room: Room) -> None:
    evidence, local = collect(room, make_tracks(room, np.random.default_rng(0)), true_edges(room))
    planes = local_planes(room, local)
    wall = planes[0]
    assert evidence.wall[0]
    others = planes.copy()
    others[0] = np.nan
    labels = [instance.label for instance in room.instances]
    level = sum(label in ("floor", "ceiling") for label in labels)
    # Right angles with floors and ceilings: a wall that leans by .1 radians costs (sin .1 / .15)² of each.
    up = np.array([0.0, 0.0, 1.0])
    leaning = np.append(np.cos(0.1) * wall[:3] + np.sin(0.1) * up, wall[3])
    expected = 10.0 * level * (np.sin(0.1) / 0.15) ** 2
    assert cost(room, evidence, leaning, others, perpendicularity_weight=10.0) == pytest.approx(expected)
    flat = np.append(up, wall[3])
    assert cost(room, evidence, flat, others, perpendicularity_weight=10.0) == pytest.approx(10.0 * level)
    # Other walls: at right angles or parallel nothing, odd ones up to one in the mean.
    assert cost(room, evidence, wall, others, manhattan_weight=2.0) == pytest.approx(0.0, abs=1e-9)
    odd = np.append(np.cos(0.5) * wall[:3] + np.sin(0.5) * np.cross(up, wall[:3]), wall[3])
    assert cost(room, evidence, odd, others, manhattan_weight=2.0) == pytest.approx(2.0)
    slight = np.append(np.cos(0.05) * wall[:3] + np.sin(0.05) * np.cross(up, wall[:3]), wall[3])
    expected = 2.0 * (np.sin(0.05) / 0.15) ** 2
    assert cost(room, evidence, slight, others, manhattan_weight=2.0) == pytest.approx(expected, rel=1e-6)
    # Depths: behind the cameras everywhere is absurd.
    behind = np.append(wall[:3], -100.0)
    assert cost(room, evidence, behind, others, absurd_weight=5.0) == pytest.approx(5.0)
    assert cost(room, evidence, wall, others, absurd_weight=5.0) == 0.0


def test_tracks_cost_their_share_that_lies_off_and_no_more_than_so_many(room: Room) -> None:
    evidence, local = collect(room, make_tracks(room, np.random.default_rng(0)), true_edges(room))
    planes = local_planes(room, local)
    nowhere = np.full_like(planes, np.nan)
    far = planes[0] * [1, 1, 1, 50.0]
    assert cost(room, evidence, far, nowhere, max_track_weight=60.0) == pytest.approx(60.0)
    assert cost(room, evidence, far, nowhere, max_track_weight=5.0) == pytest.approx(5.0)
    assert cost(room, evidence, planes[0], nowhere, max_track_weight=60.0) < 10.0


def test_planes_through_points_are_nan_where_these_lie_on_a_line() -> None:
    a, b = np.array([[0.0, 0, 5], [0, 0, 5]]), np.array([[1.0, 0, 5], [1, 0, 5]])
    c = np.array([[0.0, 2, 5], [3, 0, 5]])
    plane, none = initialization._through_points(a, b, c)
    np.testing.assert_allclose(np.abs(plane), [0, 0, 1, 5])
    assert plane[2] * 5 + plane[3] == 0.0
    assert np.isnan(none).all()
