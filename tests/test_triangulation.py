"""Inverse depth of tracks: exact without noise, honest about its σ with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtlayout.scene import Camera, FloatArray, Scene
from gtlayout.tracking.config import TriangulationConfig
from gtlayout.tracking.follow import infinite_homography
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import camera_path, parallax_deg, triangulate
from simulated.simulated_room import look_at, make_room, orbit
from simulated.simulation import make_tracks, no_tracks

CONFIG = TriangulationConfig()


def one_point(cameras: list[Camera], point_world: FloatArray, copies: int = 1) -> tuple[Scene, Tracks]:
    """``copies`` tracks of one world point through all cameras, sampled in the first; without noise."""
    scene = make_room(cameras, [0]).scene
    seen = np.concatenate([camera.project(point_world[None])[0] for camera in cameras])
    count = len(cameras)
    return scene, Tracks(
        key_frame=np.zeros(copies, dtype=np.int64),
        element=np.zeros(copies, dtype=np.int64),
        track=np.repeat(np.arange(copies), count),
        frame=np.tile(np.arange(count), copies),
        points_px=np.tile(seen, (copies, 1)),
        sigma_px=np.ones(copies),
        tried=(np.array([copies]),),
    )


def sideways(count: int, step_m: float = 0.08) -> list[Camera]:
    return [
        look_at(np.array([1.0 + step_m * i, 1.0, 1.4]), np.array([2.0 + step_m * i, 5.0, 1.2])) for i in range(count)
    ]


def test_without_noise_every_point_is_exact() -> None:
    room = make_room(orbit(), [2, 10, 18])
    tracks = make_tracks(room, np.random.default_rng(0), sigma_px=0.0)
    rays = triangulate(room.scene, tracks, CONFIG)
    points = rays.points_world()
    planes = room.planes[[room.instance_of[k][e] for k, e in zip(tracks.key_frame, tracks.element, strict=True)]]
    np.testing.assert_allclose(np.sum(points * planes[:, :3], axis=1) + planes[:, 3], 0, atol=1e-7)
    # … and each lies on the ray of the pixel it was sampled at.
    for k in range(3):
        here = tracks.key_frame == k
        projected, depth = room.scene.frame_of(k).camera.project(points[here])
        np.testing.assert_allclose(projected, rays.key_px[here], atol=1e-8)
        np.testing.assert_allclose(depth, 1 / rays.rho[here], rtol=1e-9)


@pytest.mark.parametrize("sigma_px", [0.5, 1.0])
def test_sigma_is_the_scatter_of_repeated_measurements(sigma_px: float) -> None:
    scene, tracks = one_point(sideways(9), np.array([1.5, 5.0, 1.0]), copies=1500)
    noise = sigma_px * np.random.default_rng(0).normal(size=tracks.points_px.shape)
    noise[tracks.frame == 0] = 0.0
    noisy = replace(tracks, points_px=tracks.points_px + noise, sigma_px=np.full(1500, sigma_px))
    exact = triangulate(scene, tracks, CONFIG).rho[0]
    rays = triangulate(scene, noisy, CONFIG)
    scatter = rays.rho.std()
    assert abs(rays.rho.mean() - exact) < 4 * scatter / np.sqrt(1500)
    # The Cauchy kernel takes some of the Gaussian's information away; its own estimate of that is approximate.
    assert np.median(rays.sigma_rho) == pytest.approx(scatter, rel=0.2)


def test_less_baseline_is_less_certain() -> None:
    sigmas = []
    for step_m in (0.08, 0.04):
        scene, tracks = one_point(sideways(9, step_m), np.array([1.5, 5.0, 1.0]))
        sigmas.append(triangulate(scene, tracks, CONFIG).sigma_rho[0])
    assert sigmas[1] / sigmas[0] == pytest.approx(2.0, rel=0.05)


def test_without_parallax_nothing_is_known() -> None:
    center = np.array([1.0, 1.0, 1.4])
    turning = [look_at(center, np.array([2.0 + 0.1 * i, 5.0, 1.2])) for i in range(9)]
    scene, tracks = one_point(turning, np.array([1.5, 5.0, 1.0]))
    rays = triangulate(scene, tracks, CONFIG)
    assert rays.sigma_rho[0] > 1000 * rays.rho[0]
    assert np.isfinite(rays.rho).all() and (rays.rho > 0).all()
    assert parallax_deg(scene, tracks, rays) == pytest.approx([0.0], abs=1e-5)


def test_one_wrong_position_does_not_matter() -> None:
    scene, tracks = one_point(sideways(9), np.array([1.5, 5.0, 1.0]))
    exact = triangulate(scene, tracks, CONFIG).rho[0]
    shifted = tracks.points_px.copy()
    shifted[5] += [40.0, -10.0]
    # The least-squares solution would be off by some ten per cent.
    assert triangulate(scene, replace(tracks, points_px=shifted), CONFIG).rho[0] == pytest.approx(exact, rel=0.01)


def test_a_point_that_moves_the_wrong_way_stays_in_the_depth_range() -> None:
    scene, tracks = one_point(sideways(9), np.array([1.5, 5.0, 1.0]))
    backwards = tracks.points_px[0] - 5 * (tracks.points_px - tracks.points_px[0])
    rays = triangulate(scene, replace(tracks, points_px=backwards), CONFIG)
    near, far = camera_path(scene) * np.array(CONFIG.depth_range_paths)
    assert 1 / far * (1 - 1e-9) <= rays.rho[0] <= 1 / near


def test_the_unit_of_the_world_does_not_matter() -> None:
    cameras = orbit()
    metre = make_room(cameras, [2, 10, 18], metric=False)
    other = make_room(cameras, [2, 10, 18], scale=137.0, shift=np.array([1000.0, -1000.0, 1000.0]), metric=False)
    a, b = (triangulate(room.scene, make_tracks(room, np.random.default_rng(0)), CONFIG) for room in (metre, other))
    np.testing.assert_allclose(a.rho, 137 * b.rho, rtol=1e-6)
    np.testing.assert_allclose(a.sigma_rho, 137 * b.sigma_rho, rtol=1e-6)


def test_depths_that_are_not_known_end_near_the_others() -> None:
    """With and without a unit alike: a point at infinity is no further away than so many median depths."""
    room = make_room(orbit(), [2, 10, 18], metric=True)
    tracks = make_tracks(room, np.random.default_rng(0))
    far = tracks.track == 7
    key = np.array([key_frame.frame for key_frame in room.scene.key_frames])[tracks.key_frame[7]]
    cameras = [frame.camera for frame in room.scene.frames]
    at_key = tracks.points_px[far & (tracks.frame == key)]
    turned = [infinite_homography(cameras[key], cameras[f]) @ np.append(at_key, 1.0) for f in tracks.frame[far]]
    points_px = tracks.points_px.copy()
    points_px[far] = [turn[:2] / turn[2] for turn in turned]
    for metric in (True, False):
        rays = triangulate(replace(room.scene, metric=metric), replace(tracks, points_px=points_px), CONFIG)
        assert np.median(rays.rho) / rays.rho[7] == pytest.approx(CONFIG.depth_range_medians[1], rel=0.01)


def test_no_tracks_are_no_rays() -> None:
    scene = make_room(orbit(), [2]).scene
    rays = triangulate(scene, no_tracks(scene), CONFIG)
    assert rays.rho.shape == (0,)
    assert rays.points_world().shape == (0, 3)
    assert parallax_deg(scene, no_tracks(scene), rays).shape == (0,)


def test_parallax_is_the_largest_angle_between_two_rays() -> None:
    """An equilateral triangle of two cameras and the point; the sampling camera stands between the two."""
    point = np.array([2.0, 4.0, 1.4])
    centers = [point - [x, np.sqrt(3.0), 0.0] for x in (0.0, 1.0, 0.3, -1.0)]
    scene, tracks = one_point([look_at(center, point) for center in centers], point, copies=2)
    # The second track lacks the last camera: its widest pair is that of x = 0 and 1, at 30°.
    kept = np.arange(8) != 7
    short = replace(tracks, track=tracks.track[kept], frame=tracks.frame[kept], points_px=tracks.points_px[kept])
    rays = triangulate(scene, short, CONFIG)
    assert parallax_deg(scene, short, rays) == pytest.approx([60.0, 30.0], abs=1e-5)


def test_a_camera_that_only_turns_has_no_path() -> None:
    center = np.array([100.1, -200.3, 1.4])
    turning = [look_at(center, center + np.array([np.cos(a), np.sin(a), -0.1])) for a in np.linspace(0, 3, 20)]
    assert camera_path(make_room(turning, [0]).scene) == 0.0
    assert camera_path(make_room(sideways(5), [0]).scene) == pytest.approx(0.32)
