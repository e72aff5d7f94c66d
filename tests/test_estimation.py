"""Stage 4 on simulated box rooms: exact without noise, robust, honest about what it does not know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.instances import Instance
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.estimate import Estimate
from gtlayout.planes.estimation import estimate
from gtlayout.scene import Element, KeyFrame
from gtlayout.tracking.config import TriangulationConfig
from gtlayout.tracking.triangulation import triangulate
from simulated.simulated_edges import jitter, true_edges
from simulated.simulated_room import Room, as_multi, box_faces, look_at, make_room, orbit
from simulated.simulation import chosen, errors, make_tracks, measurements, nees, no_tracks, solve

KEY_FRAMES = [2, 6, 10, 14, 18]
EXACT = EstimationConfig(converged_below=0.0, relative_decrease=1e-9)
"""No early stop: how far rounding lets the solve get."""


@pytest.fixture(scope="module")
def room() -> Room:
    return make_room(orbit(), KEY_FRAMES)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def far_wall(room: Room) -> int:
    return next(i for i, plane in enumerate(room.planes) if plane[1] < -0.9)


def depth_sigma(room: Room, solved: Estimate, i: int) -> float:
    """σ of the depth of instance ``i`` at its seen centre, from the first camera."""
    camera = room.scene.frames[0].camera
    point = room.seen_center(i)
    ray = point - camera.center_world
    return float(solved.planes[i].sigma_depth(point, ray / (camera.R_cam_from_world[2] @ ray)))


def test_a_room_without_noise_is_exact(room: Room) -> None:
    solved = solve(room, make_tracks(room, rng(), sigma_px=0.0), config=EXACT)
    angles_deg, offsets = errors(room, solved.planes)
    assert angles_deg.max() < 1e-6
    assert np.abs(offsets).max() < 1e-7
    assert all(plane.observable and plane.note == "" for plane in solved.planes)
    for plane, truth in zip(solved.planes, room.planes, strict=True):
        assert plane.normal @ truth[:3] > 0, "normals point towards the cameras"
        assert np.linalg.norm(plane.normal) == pytest.approx(1.0, abs=1e-12)


def test_default_stopping_is_good_to_a_millionth(room: Room) -> None:
    angles_deg, offsets = errors(room, solve(room, make_tracks(room, rng(), sigma_px=0.0)).planes)
    assert np.deg2rad(angles_deg).max() < 1e-4
    assert np.abs(offsets).max() < 1e-4


def test_covariances_have_rank_three_along_the_sphere_of_normals(room: Room) -> None:
    for plane in solve(room, make_tracks(room, rng())).planes:
        np.testing.assert_allclose(plane.covariance, plane.covariance.T, rtol=1e-9)
        np.testing.assert_allclose(plane.covariance[:3, :3] @ plane.normal, 0, atol=1e-12)
        assert np.linalg.matrix_rank(plane.covariance, tol=1e-12) == 3


@pytest.mark.parametrize(("drifting", "shifted"), [(0.0, 0.0), (0.1, 0.0), (0.0, 0.15), (0.1, 0.15)])
def test_a_noisy_orbit_is_good_to_a_centimetre(room: Room, drifting: float, shifted: float) -> None:
    for seed in range(2):
        noise = rng(seed)
        edges = jitter(true_edges(room), noise, shift_px=1.6, tilt_px=0.6)
        wrong = noise.permutation(len(edges))[: round(shifted * len(edges))]
        for e in wrong:
            along = edges[e].points_px[-1] - edges[e].points_px[0]
            across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
            edges[e] = replace(edges[e], points_px=edges[e].points_px + 40 * across)
        tracks = make_tracks(room, noise, relief=0.005, drifting=drifting)
        solved = solve(room, tracks, edges)
        angles_deg, offsets = errors(room, solved.planes)
        # A line 40 px off still pulls a little: Cauchy's kernel never lets go altogether.
        assert angles_deg.max() < (0.5 if shifted else 0.3)
        assert np.abs(offsets).max() < 0.01


def test_tracks_that_slide_are_told_from_those_that_do_not(room: Room) -> None:
    tracks = make_tracks(room, rng())
    # One track in ten jumps by half its depth: every later position is moved along the epipolar line.
    bad = np.arange(len(tracks)) % 10 == 0
    rays = triangulate(room.scene, tracks, TriangulationConfig())
    points = rays.center + 1.5 * rays.ray / rays.rho[:, None]
    wrong_px = np.array(
        [
            room.scene.frames[f].camera.project(points[n][None])[0][0]
            for n, f in zip(tracks.track, tracks.frame, strict=True)
        ]
    )
    mirrored = replace(tracks, points_px=np.where(bad[tracks.track, None], wrong_px, tracks.points_px))
    solved = solve(room, mirrored)
    angles_deg, offsets = errors(room, solved.planes)
    assert angles_deg.max() < 0.3 and np.abs(offsets).max() < 0.01
    assert solved.landmark_weight[bad].max() < 0.1
    assert np.median(solved.landmark_weight[~bad]) > 0.8
    # Those that take part lie on their planes.
    instance = solved.landmark_instance
    assert np.array_equal(instance >= 0, np.isfinite(solved.landmarks[:, 0]))
    for n in np.nonzero(~bad)[0]:
        plane = solved.planes[instance[n]]
        assert abs(plane.normal @ solved.landmarks[n] + plane.d) < 0.03


@pytest.mark.parametrize("seed", range(3))
def test_a_wall_without_tracks_is_placed_by_its_edges(room: Room, seed: int) -> None:
    wall = far_wall(room)
    edges = jitter(true_edges(room), rng(seed), shift_px=1.6, tilt_px=0.6)
    solved = solve(room, make_tracks(room, rng(seed), without=[wall]), edges)
    angles_deg, offsets = errors(room, solved.planes)
    assert solved.planes[wall].support.tracks == 0
    assert solved.planes[wall].observable
    assert abs(offsets[wall]) < 0.05
    assert angles_deg[wall] < 1.0
    assert nees(room, solved.planes)[wall] < 11.3, "outside the ellipsoid that holds 99 %"
    with_tracks = solve(room, make_tracks(room, rng(seed)), edges)
    assert depth_sigma(room, solved, wall) > depth_sigma(room, with_tracks, wall)


def test_a_wall_with_neither_tracks_nor_edges_is_called_unobservable(room: Room) -> None:
    wall = far_wall(room)
    edges = [edge for edge in true_edges(room) if wall not in edge.instances]
    solved = solve(room, make_tracks(room, rng(), without=[wall]), edges)
    assert [plane.observable for plane in solved.planes] == [i != wall for i in range(len(room.instances))]
    assert solved.planes[wall].note != ""
    # Its σ can be asked for, and says that nothing is known.
    assert not solved.planes[wall].sigma_normal_deg < 30
    others = np.arange(len(room.instances)) != wall
    angles_deg, offsets = errors(room, solved.planes)
    assert angles_deg[others].max() < 0.3 and np.abs(offsets[others]).max() < 0.01


def test_a_wall_on_one_edge_alone_is_not_certain_of_its_angle() -> None:
    # A slanted surface may stand at any angle: its edge with the floor leaves one turn open.
    faces = list(box_faces())
    faces[5] = replace(faces[5], label="slanted")
    room = make_room(orbit(), KEY_FRAMES, faces)
    slanted = room.index("slanted")
    floor = room.index("floor")
    edges = [edge for edge in true_edges(room) if slanted not in edge.instances or floor in edge.instances]
    solved = solve(room, make_tracks(room, rng(), without=[slanted]), edges)
    plane = solved.planes[slanted]
    assert not plane.observable or plane.sigma_normal_deg > 10


def test_a_camera_that_does_not_move_names_all_planes() -> None:
    center = np.array([1.2, 1.1, 1.4])
    turning = [look_at(center, np.array([3.0 - 0.02 * i, 4.2, 1.15])) for i in range(21)]
    room = make_room(turning, KEY_FRAMES)
    tracks = make_tracks(room, rng())
    with pytest.raises(GtlayoutError) as caught:
        solve(room, tracks)
    message = str(caught.value)
    assert "\n" not in message and "move" in message
    assert all(instance.name in message for instance in room.instances)


@pytest.mark.parametrize("sweep_m", [1e-4, 1e-3])
def test_a_camera_that_hardly_moves_is_not_believed(sweep_m: float) -> None:
    room = make_room(orbit(sweep_m=sweep_m), KEY_FRAMES)
    try:
        solved = solve(room, make_tracks(room, rng()))
    except GtlayoutError as error:
        assert all(instance.name in str(error) for instance in room.instances)
    else:
        assert not any(plane.observable for plane in solved.planes)


def test_nothing_tracked_names_all_planes(room: Room) -> None:
    tracks = no_tracks(room.scene)
    with pytest.raises(GtlayoutError, match="no point could be tracked") as caught:
        solve(room, tracks)
    assert all(instance.name in str(caught.value) for instance in room.instances)


def test_nothing_annotated_is_told(room: Room) -> None:
    empty = replace(room.scene, key_frames=())
    measured = measurements(room, no_tracks(room.scene), ())
    with pytest.raises(GtlayoutError, match="annotated"):
        estimate(replace(measured, scene=empty, instances=()), EstimationConfig(), 0)


def test_the_unit_and_the_origin_of_the_world_do_not_matter() -> None:
    scale, shift = 137.0, np.array([1000.0, -1000.0, 1000.0])
    here = make_room(orbit(), KEY_FRAMES, metric=False)
    there = make_room(orbit(), KEY_FRAMES, scale=scale, shift=shift, metric=False)
    a, b = (solve(room, make_tracks(room, rng(), drifting=0.1)) for room in (here, there))
    for plane, other in zip(a.planes, b.planes, strict=True):
        np.testing.assert_allclose(other.normal, plane.normal, atol=1e-6)
        assert other.d + other.normal @ shift == pytest.approx(scale * plane.d, abs=1e-5 * scale)
        assert other.sigma_normal_deg == pytest.approx(plane.sigma_normal_deg, rel=1e-4)
    for i in range(len(here.instances)):
        assert depth_sigma(there, b, i) == pytest.approx(scale * depth_sigma(here, a, i), rel=1e-4)
    angles_deg, offsets = errors(there, b.planes)
    assert angles_deg.max() < 0.3
    assert np.abs(offsets).max() < 0.01 * scale


def test_a_metric_room_far_from_the_origin_is_the_same_room(room: Room) -> None:
    far = make_room(orbit(), KEY_FRAMES, shift=np.array([1000.0, -1000.0, 1000.0]))
    a, b = (solve(r, make_tracks(r, rng())) for r in (room, far))
    for i in range(len(room.instances)):
        np.testing.assert_allclose(b.planes[i].normal, a.planes[i].normal, atol=1e-6)
        assert depth_sigma(far, b, i) == pytest.approx(depth_sigma(room, a, i), rel=1e-4)


def test_marginals_are_calibrated(room: Room) -> None:
    # The noise model's own noise, and nothing that all points share.
    config = EstimationConfig(relative_depth_sigma=0.0)
    values = []
    for seed in range(5):
        noise = rng(seed)
        edges = jitter(true_edges(room), noise, config.sigma_edge_shift_px, config.sigma_edge_tilt_px)
        tracks = make_tracks(room, noise, sigma_px=1.0, relief=config.sigma_relief)
        values.append(nees(room, solve(room, tracks, edges, config).planes))
    # 3 is expected were all observations of a track independent; the model takes up to half of them to be so.
    assert 0.3 < np.mean(values) < 4.5
    assert np.mean(np.array(values) < 7.81) > 0.9, "the 95 % ellipsoids"


def test_sigma_covers_an_error_that_all_points_share(room: Room) -> None:
    # Camera centres 0.5 % too far apart: every depth is 0.5 % too large, and no residual shows it.
    cameras = [frame.camera for frame in room.scene.frames]
    anchor = cameras[0].center_world
    frames = []
    for frame, camera in zip(room.scene.frames, cameras, strict=True):
        center = anchor + 1.005 * (camera.center_world - anchor)
        moved = replace(camera, t_cam_from_world=-camera.R_cam_from_world @ center)
        frames.append(replace(frame, camera=moved))
    tracks = make_tracks(room, rng())
    wrong = replace(room, scene=replace(room.scene, frames=tuple(frames)))
    solved = solve(wrong, tracks)
    assert np.all(nees(room, solved.planes) < 7.81)
    for i in range(len(room.instances)):
        depth = np.linalg.norm(room.seen_center(i) - anchor)
        assert 0.0015 * depth < depth_sigma(room, solved, i) < 0.05 * depth


def with_door() -> tuple[Room, int, int]:
    """The room with a door in its far wall: a second polygon of its own, 2 m high. Returns also door and wall."""
    corners = np.array([[2.0, 5, 0], [2.0, 5, 2], [2.9, 5, 2], [2.9, 5, 0]])
    faces = [*box_faces(), replace(box_faces()[5], label="door", corners=corners)]
    doored = make_room(orbit(), KEY_FRAMES, faces)
    door = next(i for i, instance in enumerate(doored.instances) if instance.label == "door")
    wall = next(i for i, p in enumerate(doored.planes) if p[1] < -0.9 and i != door)
    instances = list(doored.instances)
    instances[door] = replace(instances[door], host=wall)
    return replace(doored, instances=tuple(instances)), door, wall


def test_a_door_without_tracks_lies_in_its_wall(room: Room) -> None:
    doored, door, wall = with_door()
    edges = [edge for edge in true_edges(room) if len(edge.points_px) > 5]
    names = {instance.name: i for i, instance in enumerate(doored.instances)}
    renamed = [
        replace(e, instances=tuple(names[room.instances[i].name] for i in e.instances))  # type: ignore[arg-type]
        for e in edges
    ]
    solved = solve(doored, make_tracks(doored, rng(), without=[door]), renamed)
    angles_deg, offsets = errors(doored, solved.planes)
    assert solved.planes[door].observable
    assert angles_deg[door] < 0.3 and abs(offsets[door]) < 0.01
    # It may sit back in the wall by some centimetres, and its σ says so.
    assert depth_sigma(doored, solved, door) > depth_sigma(doored, solved, wall)
    assert depth_sigma(doored, solved, door) > 0.9 * EstimationConfig().sigma_recess


def test_an_instance_that_is_nothing_but_a_name_does_no_harm(room: Room) -> None:
    # Drawn in one key frame, on nothing that was tracked and beside nothing.
    extra = Element("x", "wall", as_multi(room.scene.key_frames[0].elements[0].visible.buffer(-30)), MultiPolygon())
    key_frames = list(room.scene.key_frames)
    key_frames[0] = KeyFrame(key_frames[0].frame, (*key_frames[0].elements, extra))
    tracks = make_tracks(room, rng())
    tried = (np.append(tracks.tried[0], 0), *tracks.tried[1:])
    scene = replace(room.scene, key_frames=tuple(key_frames))
    instances = (*room.instances, Instance("wall_x", "wall", ((0, len(room.scene.key_frames[0].elements)),)))
    measured = replace(measurements(room, replace(tracks, tried=tried)), scene=scene, instances=instances)
    solved = estimate(measured, EstimationConfig(), 0)
    assert not solved.planes[-1].observable
    angles_deg, offsets = errors(room, solved.planes[:-1])
    assert angles_deg.max() < 0.3 and np.abs(offsets).max() < 0.01


def test_costs_fall_and_the_last_iteration_is_the_result(room: Room) -> None:
    solved = solve(room, make_tracks(room, rng(), drifting=0.1))
    assert len(solved.iterations) >= 2
    last = np.array([np.append(plane.normal, plane.d) for plane in solved.planes])
    np.testing.assert_allclose(solved.iterations[-1].planes, last, atol=1e-9)
    assert solved.iterations[-1].cost <= solved.iterations[0].cost


def test_the_same_input_gives_the_same_bytes(room: Room) -> None:
    a, b = (solve(room, make_tracks(room, rng(), drifting=0.1)) for _ in range(2))
    for plane, other in zip(a.planes, b.planes, strict=True):
        assert plane.normal.tobytes() == other.normal.tobytes()
        assert plane.d == other.d
        assert plane.covariance.tobytes() == other.covariance.tobytes()
    assert a.landmarks.tobytes() == b.landmarks.tobytes()
    assert a.landmark_weight.tobytes() == b.landmark_weight.tobytes()


def test_the_seed_only_decides_where_the_search_looks(room: Room) -> None:
    tracks = make_tracks(room, rng(), drifting=0.1)
    a, b = (solve(room, tracks, seed=seed) for seed in (0, 1))
    for plane, other in zip(a.planes, b.planes, strict=True):
        np.testing.assert_allclose(plane.normal, other.normal, atol=1e-3)


def test_two_tracks_alone_place_nothing_and_say_so() -> None:
    room = make_room(orbit(), KEY_FRAMES)
    tracks = chosen(make_tracks(room, np.random.default_rng(0)), np.array([0, 1]))
    with pytest.raises(GtlayoutError, match=r"unobservable: .*floor"):
        solve(room, tracks, [])
