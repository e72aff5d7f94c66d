"""Errors that all cameras share: found with their size, corrected, and nothing found where there is none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gtlayout.api import load, load_solved, save
from gtlayout.camera_errors.find import find_camera_errors
from gtlayout.camera_errors.findings import CameraDoubt, Finding
from gtlayout.camera_errors.models import camera_errors, corrected
from gtlayout.camera_errors.noise import PoseNoise, noisy
from gtlayout.camera_errors.observations import Observations, frames_seen, observe
from gtlayout.camera_errors.path import CameraPath
from gtlayout.camera_errors.propagate import camera_response
from gtlayout.camera_errors.reprojection import DIMENSIONS, linearise
from gtlayout.camera_errors.wording import camera_error_lines
from gtlayout.config import Config
from gtlayout.method import prepare, solve
from gtlayout.scene import Camera, FloatArray, Scene
from gtlayout.synth.errors import CameraErrors, disturb_cameras
from gtlayout.tracking.config import CameraErrorConfig, TriangulationConfig
from gtlayout.tracking.tracks import Tracks, evenly_spread
from gtlayout.tracking.triangulation import triangulate
from simulated.simulated_room import Room, make_room, orbit
from simulated.simulation import make_tracks
from variants.spoiled_cameras import Cameras, late, other_focal, rolled, scale_drift, yaw_drift
from variants.variant import with_cameras

CONFIG, TRIANGULATION = CameraErrorConfig(), TriangulationConfig()
ERRORS = camera_errors(CONFIG)
NAMES = [error.name for error in ERRORS]
KEY_FRAMES = [3, 15, 27]
FRAMES = 31


def other_principal_point(cameras: Sequence[Camera], x: float, y: float) -> Cameras:
    """Moved by shares of the image's width."""
    shift = np.zeros((3, 3))
    shift[:2, 2] = x, y
    return tuple(replace(camera, K=camera.K + camera.width * shift) for camera in cameras)


SPOILED: dict[str, tuple[str, Callable[[Sequence[Camera]], Cameras], float]] = {
    "focal length + 5 %": ("focal length", lambda cameras: other_focal(cameras, 1.05), np.log(1 / 1.05)),
    "focal length − 4 %": ("focal length", lambda cameras: other_focal(cameras, 0.96), np.log(1 / 0.96)),
    "principal point": ("principal point", lambda cameras: other_principal_point(cameras, 0.05, 0.03), 0.0583),
    "roll": ("roll", lambda cameras: rolled(cameras, 3.0), np.deg2rad(-3.0)),
    "heading": ("heading", lambda cameras: yaw_drift(cameras, 4.0), np.deg2rad(4.0)),
    "scale": ("scale", lambda cameras: scale_drift(cameras, 0.5), -0.51),
    "2 frames late": ("delay", lambda cameras: late(cameras, 2), 2.0),
}
"""Name → the error, how cameras come to have it, and the value that corrects it, or its length."""


@pytest.fixture(scope="module")
def simulated() -> Room:
    return make_room(orbit(FRAMES), KEY_FRAMES)


@pytest.fixture(scope="module")
def tracks(simulated: Room) -> Tracks:
    return make_tracks(simulated, np.random.default_rng(0), per_element=30, sigma_px=0.3)


@pytest.fixture(scope="module")
def some(simulated: Room, tracks: Tracks) -> Observations:
    frames = frames_seen(simulated.scene, tracks, most=8)
    return observe(simulated.scene, tracks, np.arange(0, len(tracks), 9), frames, max_observations=4)


def look(scene: Scene, tracks: Tracks) -> CameraDoubt:
    return find_camera_errors(scene, tracks, CONFIG, TRIANGULATION, 0)


def spoil(scene: Scene, change: Callable[[Sequence[Camera]], Cameras]) -> Scene:
    return with_cameras(scene, change([frame.camera for frame in scene.frames]))


def decisions(doubt: CameraDoubt) -> dict[str, str]:
    return {finding.error.name: finding.decision for finding in doubt.findings if finding.decision != "fine"}


def found(doubt: CameraDoubt, name: str) -> Finding:
    return doubt.findings[NAMES.index(name)]


def relative(path: CameraPath) -> tuple[FloatArray, FloatArray]:
    """Rotations and centres of all cameras but the first, seen from it."""
    R = path.R_cam_from_world @ path.R_cam_from_world[0].T
    return R, (path.centers_world - path.centers_world[0]) @ path.R_cam_from_world[0].T


@pytest.mark.parametrize("name", SPOILED)
def test_what_comes_wrong_is_found_with_its_size(simulated: Room, tracks: Tracks, name: str) -> None:
    error, change, value = SPOILED[name]
    given = spoil(simulated.scene, change)
    doubt = look(given, tracks)
    assert decisions(doubt) == {error: "corrected"}
    finding = found(doubt, error)
    size = finding.values[0] if finding.error.size == 1 else finding.size
    assert abs(size - value) < 3 * finding.sigma
    assert finding.sigma < 0.3 * abs(value)
    assert doubt.corrected_px < 0.8 * doubt.given_px
    assert decisions(look(doubt.correct(given), tracks)) == {}, "nothing is left"


@pytest.mark.parametrize("name", [name for name, (error, _, _) in SPOILED.items() if error != "delay"])
def test_a_correction_undoes_what_spoiled(simulated: Room, name: str) -> None:
    error, change, value = SPOILED[name]
    given = CameraPath.of(spoil(simulated.scene, change))
    true = CameraPath.of(simulated.scene)
    values = np.array([value])
    if error == "principal point":
        values = np.array([-0.05, -0.03])
    elif error == "heading":
        values = -value * np.mean([camera.R_cam_from_world[1] for camera in cameras_of(simulated)], axis=0)
        values *= value / np.linalg.norm(values)
    elif error == "scale":
        values = np.array([np.log(0.75 / 1.25)])
    right = ERRORS[NAMES.index(error)].correct(given, values)
    np.testing.assert_allclose(right.K, true.K, rtol=1e-12)
    for ours, theirs in zip(relative(right), relative(true), strict=True):
        # Steps grow evenly by a factor here and by a share there.
        np.testing.assert_allclose(ours, theirs, atol=0.02 if error == "scale" else 1e-3)


def cameras_of(room: Room) -> list[Camera]:
    return [frame.camera for frame in room.scene.frames]


def test_late_poses_are_those_of_later_frames(simulated: Room) -> None:
    true = CameraPath.of(simulated.scene)
    given = CameraPath.of(spoil(simulated.scene, lambda cameras: late(cameras, 2)))
    delay = ERRORS[NAMES.index("delay")]
    right = delay.correct(given, np.array([2.0]))
    np.testing.assert_allclose(right.R_cam_from_world[2:-2], true.R_cam_from_world[2:-2], atol=1e-12)
    np.testing.assert_allclose(right.centers_world[2:-2], true.centers_world[2:-2], atol=1e-12)
    step = given.centers_world[-1] - given.centers_world[-2]
    np.testing.assert_allclose(right.centers_world[-1], given.centers_world[-1] + 2 * step, atol=1e-12)
    between = delay.correct(true, np.array([0.5])).centers_world
    np.testing.assert_allclose(between[:-1], (true.centers_world[:-1] + true.centers_world[1:]) / 2, atol=1e-12)


def test_two_errors_at_once_are_told_apart(simulated: Room, tracks: Tracks) -> None:
    given = spoil(simulated.scene, lambda cameras: late(other_focal(cameras, 1.06), 2))
    doubt = look(given, tracks)
    assert decisions(doubt) == {"focal length": "corrected", "delay": "corrected"}
    assert found(doubt, "focal length").values[0] == pytest.approx(-np.log(1.06), abs=0.015)
    assert found(doubt, "delay").values[0] == pytest.approx(2.0, abs=0.4)


def test_right_cameras_stay(simulated: Room, tracks: Tracks) -> None:
    doubt = look(simulated.scene, tracks)
    assert decisions(doubt) == {}
    assert doubt.correct(simulated.scene) is simulated.scene
    for finding in doubt.findings:
        assert finding.size < 3 * finding.sigma, finding.error.name


@pytest.mark.parametrize("seed", range(4))
def test_poses_with_smooth_noise_are_no_evidence(simulated: Room, tracks: Tracks, seed: int) -> None:
    poor = CameraErrors(rotation_sigma_deg=0.15, position_sigma_m=0.01)
    given = spoil(simulated.scene, lambda cameras: disturb_cameras(tuple(cameras), poor, np.random.default_rng(seed)))
    assert not look(given, tracks).corrected


def test_tracks_that_are_noise_correct_no_camera(simulated: Room, tracks: Tracks) -> None:
    noise = np.random.default_rng(1).normal(0, 40, tracks.points_px.shape)
    assert not look(simulated.scene, replace(tracks, points_px=tracks.points_px + noise)).corrected


def test_nothing_is_looked_for_where_nothing_can_be_found(simulated: Room, tracks: Tracks) -> None:
    few = make_tracks(simulated, np.random.default_rng(0), per_element=3)
    assert look(simulated.scene, few).findings == ()
    still = make_room(orbit(FRAMES, sweep_m=0.002), KEY_FRAMES)
    moved = make_tracks(still, np.random.default_rng(0), per_element=30, sigma_px=0.3)
    for scene in (still.scene, with_cameras(still.scene, (still.scene.frames[0].camera,) * FRAMES)):
        assert look(scene, moved).findings == ()


def test_the_unit_and_the_world_do_not_matter(simulated: Room, tracks: Tracks) -> None:
    given = spoil(simulated.scene, lambda cameras: other_focal(cameras, 1.05))
    larger = spoil(given, lambda cameras: tuple(replace(c, t_cam_from_world=7 * c.t_cam_from_world) for c in cameras))
    for here, there in zip(look(given, tracks).findings, look(larger, tracks).findings, strict=True):
        np.testing.assert_allclose(there.values, here.values, atol=1e-6)
        assert there.decision == here.decision


def test_two_looks_give_the_same_bytes(simulated: Room, tracks: Tracks) -> None:
    given = spoil(simulated.scene, lambda cameras: other_focal(cameras, 1.05))
    once, again = (look(given, tracks) for _ in range(2))
    assert once.values.tobytes() == again.values.tobytes()


def test_derivatives_by_cameras_and_depth(simulated: Room, tracks: Tracks, some: Observations) -> None:
    path = CameraPath.of(simulated.scene).at(some.frames)
    rho = triangulate(simulated.scene, tracks, TRIANGULATION).rho[some.tracks]
    at = linearise(path, some, rho)
    step = 1e-6

    def residual(frame: int, dimension: int, sign: int) -> FloatArray:
        change = np.zeros((len(path), DIMENSIONS))
        change[frame, dimension] = sign * step
        return linearise(_changed(path, change), some, rho).residual

    for dimension in range(DIMENSIONS):
        for frame in range(len(path)):
            numeric = (residual(frame, dimension, 1) - residual(frame, dimension, -1)) / (2 * step)
            own, key = (some.frame == frame)[:, None], (some.key_frame == frame)[:, None]
            analytic = own * at.by_camera[:, :, dimension] + key * at.by_key_camera[:, :, dimension]
            np.testing.assert_allclose(analytic, numeric, atol=2e-4, rtol=1e-5)
    numeric = linearise(path, some, rho + step).residual - linearise(path, some, rho - step).residual
    np.testing.assert_allclose(at.by_rho, numeric / (2 * step), atol=2e-4, rtol=1e-5)


def _changed(path: CameraPath, change: FloatArray) -> CameraPath:
    moved = noisy(path, change[:, :6].ravel())
    K = moved.K.copy()
    K[:, [0, 1], [0, 1]] *= np.exp(change[:, 6:7])
    K[:, :2, 2] += change[:, 7:]
    changed = replace(moved, K=K)
    np.testing.assert_allclose(path.change_to(changed), change, atol=1e-9)
    return changed


def test_the_size_of_pose_noise_is_learned() -> None:
    frames, rng = np.arange(100), np.random.default_rng(0)
    smooth, white = np.array([4e-4, 9e-4]), np.array([1e-4, 1e-6])
    true = PoseNoise.between(frames, 8.0, smooth, white)
    covariance = np.linalg.inv(true.information())
    apart = np.sqrt(3) / 8.0 * np.abs(frames[:, None] - frames)
    expected = smooth[1] * (1 + apart) * np.exp(-apart) + white[1] * np.eye(len(frames))
    np.testing.assert_allclose(covariance[3::6, 3::6], expected, atol=1e-10)
    drawn = rng.multivariate_normal(np.zeros(len(covariance)), covariance)
    least = PoseNoise.between(frames, 8.0, np.full(2, 1e-6), np.full(2, 1e-7))
    learned = least
    for _ in range(200):
        learned = learned.learned(drawn, np.zeros_like(covariance), least)
    np.testing.assert_allclose(learned.smooth, smooth, rtol=0.5)
    np.testing.assert_allclose(learned.white[0], white[0], rtol=0.2)
    assert np.all(learned.white >= least.white)


def test_noise_is_compared_by_all_of_its_sizes() -> None:
    usual = PoseNoise.between(np.arange(5), 8.0, np.array([4.0, 9.0]), np.array([1.0, 2.0]))
    assert usual.times(3.0).size_in(usual) == pytest.approx(3.0)
    assert replace(usual, smooth=usual.smooth * [25.0, 1.0]).size_in(usual) == pytest.approx(np.sqrt(28 / 4))


def test_how_far_cameras_may_be_off_is_what_their_noise_says(simulated: Room, tracks: Tracks) -> None:
    """Depths are known better by cameras without noise than by those with it, or if all counted as usual."""

    def shares(scene: Scene, config: CameraErrorConfig) -> float:
        rays, triangulation = triangulate(scene, tracks, TriangulationConfig()), TriangulationConfig()
        doubt = find_camera_errors(scene, tracks, config, triangulation, 0)
        response = camera_response(scene, scene, tracks, tracks, rays, doubt, triangulation, config, 0)
        return float(np.median(np.linalg.norm(response.rho_share, axis=1)))

    def noisy_scene(rotation_deg: float, position_m: float) -> Scene:
        errors = CameraErrors(rotation_deg, position_m)
        cameras = disturb_cameras(tuple(cameras_of(simulated)), errors, np.random.default_rng(0))
        return with_cameras(simulated.scene, cameras)

    config = CameraErrorConfig()
    exact, typical, poor = (shares(noisy_scene(*noise), config) for noise in ((0, 0), (0.05, 0.003), (0.15, 0.01)))
    one_for_all = replace(config, exact_noise_share=1.0, floor_shares=(1.0, 1.0))
    assert exact < 0.6 * shares(simulated.scene, one_for_all)
    assert 1.3 * exact < typical and 1.5 * typical < poor


def test_what_takes_part(simulated: Room, tracks: Tracks, some: Observations) -> None:
    assert np.all(np.bincount(some.track) <= 4)
    assert len(some.frames) <= 8 + len(KEY_FRAMES)
    assert set(some.frames[some.key_frame].tolist()) <= set(KEY_FRAMES)
    assert not np.any(some.frame == some.key_frame)
    rays = triangulate(simulated.scene, tracks, TRIANGULATION)
    np.testing.assert_array_equal(some.key_px, rays.key_px[some.tracks][some.track])
    part = tracks.only(np.isin(np.arange(len(tracks)), some.tracks))
    np.testing.assert_allclose(triangulate(simulated.scene, part, TRIANGULATION).center, rays.center[some.tracks])
    np.testing.assert_array_equal(part.sigma_px, tracks.sigma_px[some.tracks])


def test_positions_are_spread_over_each_track() -> None:
    track = np.repeat([4, 7, 9], [1, 5, 2])
    assert evenly_spread(track, 3).tolist() == [True, True, False, True, False, True, True, True]
    assert evenly_spread(track[:0], 3).tolist() == []


@pytest.mark.parametrize(
    ("name", "values", "line"),
    [
        ("focal length", [np.log(521 / 495)], "focal length 5.0% too short: 495 instead of 521 ± 5 px; corrected"),
        ("focal length", [np.log(480 / 495)], "focal length 3.1% too long: 495 instead of 480 ± 5 px; corrected"),
        (
            "principal point",
            [0.05, 0.0],
            "principal point 32 ± 6 px off: it lies -32 px in x and +0 px in y from where it",
        ),
        ("roll", [-0.0349], "cameras rolled about their optical axes by 2.0 ± 0.6°"),
        ("heading", [0.0, 0.0349, 0.0], "the heading drifts by 2.0 ± 0.6° from the first frame to the last"),
        ("scale", [np.log(1.3)], "steps at the start of the video are 30 ± 1 % too long against those at its end"),
        ("scale", [-np.log(1.3)], "steps at the end of the video are 30 ± 1 % too long against those at its start"),
        ("delay", [2.0], "poses 2.0 frames late"),
        ("delay", [-1.0], "poses 1.0 frames early"),
    ],
)
def test_a_line_names_the_error_with_its_number(simulated: Room, name: str, values: list[float], line: str) -> None:
    camera = cameras_of(simulated)[0]
    K = camera.K * np.array([[495 / camera.K[0, 0], 1, 1], [1, 1, 1], [1, 1, 1]])
    scene = with_cameras(simulated.scene, [replace(camera, K=K, width=640)] * FRAMES)
    error = ERRORS[NAMES.index(name)]
    finding = Finding(error, np.array(values), 0.01**2 * np.eye(error.size), "corrected")
    (said,) = camera_error_lines(scene, CameraDoubt((finding,)))
    assert line in said.replace("2.0 ± 0.0 frames", "2.0 frames").replace("1.0 ± 0.0 frames", "1.0 frames")
    (doubted,) = camera_error_lines(scene, CameraDoubt((replace(finding, decision="doubted"),)))
    assert "; not corrected: " in doubted
    assert camera_error_lines(scene, CameraDoubt((replace(finding, decision="fine"),))) == ()


def test_cameras_change_by_a_value_of_what_stays(simulated: Room, tracks: Tracks) -> None:
    given = spoil(simulated.scene, lambda cameras: other_focal(cameras, 1.05))
    doubt = look(given, tracks)
    right = doubt.correct(given)
    values = np.zeros(len(doubt.values))
    values[0] = found(doubt, "focal length").sigma
    moved = doubt.changed(right, values)
    ratio = moved.frames[0].camera.K[0, 0] / right.frames[0].camera.K[0, 0]
    assert ratio == pytest.approx(np.exp(values[0]))
    path = corrected(CameraPath.of(given), ERRORS, doubt.values)
    np.testing.assert_array_equal(path.K[0], right.frames[0].camera.K)


def test_a_solve_corrects_says_so_and_is_read_back(room: Path, tmp_path: Path) -> None:
    true = load(room)
    given = spoil(true, lambda cameras: other_focal(cameras, 1.06))
    solution = solve(given)
    (line,) = [warning for warning in solution.scene.warnings if "focal length" in warning]
    assert line.endswith("; corrected")
    right = solution.scene.frames[0].camera.K[0, 0]
    assert right == pytest.approx(true.frames[0].camera.K[0, 0], rel=0.02)
    save(solution, tmp_path)
    scene, _ = load_solved(room, tmp_path)
    assert scene.frames[0].camera.K[0, 0] == pytest.approx(right, rel=1e-9)


def test_a_solve_keeps_right_cameras_to_the_byte(room: Path) -> None:
    prepared = prepare(load(room), Config())
    assert prepared.given_scene is prepared.form.given
    assert [finding.error.name for finding in prepared.camera_doubt.findings] == NAMES
