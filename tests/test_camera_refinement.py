"""Refined cameras: nearer to the truth where poses are poor, the given ones where nothing proves them wrong."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtlayout.cli.app import main
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.io.scene_folder import load_scene
from gtlayout.results.refined_cameras import FILE, refined_cameras_text, with_refined_cameras
from gtlayout.results.tables import camera_line
from gtlayout.scene import Camera, Scene
from gtlayout.synth.errors import CameraErrors, disturb_cameras
from gtlayout.tracking.bundle_adjustment import CameraReport, refine_cameras
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import triangulate
from simulated.simulated_room import Room, make_room, orbit
from simulated.simulation import make_tracks

CONFIG = Config(refine_cameras=True)
POOR = CameraErrors(rotation_sigma_deg=0.15, position_sigma_m=0.01)
KEY_FRAMES = [2, 10, 18]


def with_cameras(scene: Scene, cameras: tuple[Camera, ...]) -> Scene:
    frames = zip(scene.frames, cameras, strict=True)
    return replace(scene, frames=tuple(replace(frame, camera=camera) for frame, camera in frames))


def disturbed(scene: Scene, errors: CameraErrors = POOR) -> Scene:
    cameras = tuple(frame.camera for frame in scene.frames)
    return with_cameras(scene, disturb_cameras(cameras, errors, np.random.default_rng(3)))


def jittered(scene: Scene, rotation_deg: float, position: float) -> Scene:
    """The scene with errors that have nothing in common from frame to frame."""
    rng = np.random.default_rng(4)
    cameras = []
    for camera in (frame.camera for frame in scene.frames):
        turn = Rotation.from_rotvec(np.deg2rad(rotation_deg) * rng.standard_normal(3)).as_matrix()
        R_cam_from_world = turn @ camera.R_cam_from_world
        center = camera.center_world + position * rng.standard_normal(3)
        moved = replace(camera, R_cam_from_world=R_cam_from_world, t_cam_from_world=-R_cam_from_world @ center)
        cameras.append(moved)
    return with_cameras(scene, tuple(cameras))


def refined(scene: Scene, tracks: Tracks) -> tuple[Scene, CameraReport]:
    rays = triangulate(scene, tracks, CONFIG.triangulation)
    return refine_cameras(scene, tracks, rays, CONFIG.camera_refinement, CONFIG.triangulation, CONFIG.seed)


def errors(scene: Scene, truth: Scene) -> tuple[float, float]:
    """RMS error of the cameras' rotations, degrees, and of their centres, after the best rigid motion of the world."""
    cameras, true = ([frame.camera for frame in each.frames] for each in (scene, truth))
    R = np.array([camera.R_cam_from_world for camera in cameras])
    R_true = np.array([camera.R_cam_from_world for camera in true])
    centers = np.array([camera.center_world for camera in cameras])
    true_centers = np.array([camera.center_world for camera in true])
    world = Rotation.from_matrix(R.transpose(0, 2, 1) @ R_true).mean().as_matrix()
    turns = Rotation.from_matrix(R @ world @ R_true.transpose(0, 2, 1)).magnitude()
    shifts = (centers - centers.mean(axis=0)) @ world - (true_centers - true_centers.mean(axis=0))
    return float(np.rad2deg(np.sqrt(np.mean(turns**2)))), float(np.sqrt(np.mean(np.sum(shifts**2, axis=1))))


@pytest.fixture(scope="module")
def simulated() -> Room:
    return make_room(orbit(), KEY_FRAMES)


@pytest.fixture(scope="module")
def tracks(simulated: Room) -> Tracks:
    return make_tracks(simulated, np.random.default_rng(0), per_element=30, sigma_px=0.3)


def test_independent_errors_of_the_cameras_shrink_to_a_quarter(simulated: Room, tracks: Tracks) -> None:
    given = jittered(simulated.scene, 0.15, 0.01)
    better, report = refined(given, tracks)
    assert report.refined
    before, after = errors(given, simulated.scene), errors(better, simulated.scene)
    assert after[0] < 0.25 * before[0]
    assert after[1] < 0.25 * before[1]
    assert report.refined_px < 0.25 * report.given_px
    assert 0.05 < report.rotation_deg < 0.5
    assert 0.003 < report.shift < 0.03


def test_drift_shrinks_less_and_the_world_stays_where_it_was(simulated: Room, tracks: Tracks) -> None:
    given = disturbed(simulated.scene)
    better, report = refined(given, tracks)
    assert report.refined
    before, after = errors(given, simulated.scene), errors(better, simulated.scene)
    assert after[0] < 0.8 * before[0]
    assert after[1] < 0.8 * before[1]
    old, new = (np.array([frame.camera.center_world for frame in each.frames]) for each in (given, better))
    np.testing.assert_allclose(new.mean(axis=0), old.mean(axis=0), atol=1e-3)
    size = [np.linalg.norm(centers - centers.mean(axis=0)) for centers in (old, new)]
    assert size[1] == pytest.approx(size[0], rel=5e-3)


def test_without_a_unit_the_same_scene_is_refined_alike(simulated: Room, tracks: Tracks) -> None:
    given = replace(jittered(simulated.scene, 0.15, 0.01), metric=False)
    larger = tuple(replace(frame.camera, t_cam_from_world=7 * frame.camera.t_cam_from_world) for frame in given.frames)
    once, report = refined(given, tracks)
    scaled, scaled_report = refined(with_cameras(given, larger), tracks)
    assert scaled_report.shift == pytest.approx(7 * report.shift, rel=1e-3)
    for frame, same in zip(once.frames, scaled.frames, strict=True):
        np.testing.assert_allclose(same.camera.center_world, 7 * frame.camera.center_world, atol=1e-3)


def test_true_cameras_stay(simulated: Room, tracks: Tracks) -> None:
    scene, report = refined(simulated.scene, tracks)
    assert scene is simulated.scene
    assert not report.refined
    assert "px" in report.kept_because


def test_tracks_that_are_noise_move_no_camera(simulated: Room, tracks: Tracks) -> None:
    given = disturbed(simulated.scene)
    noise = np.random.default_rng(1).normal(0, 40, tracks.points_px.shape)
    scene, report = refined(given, replace(tracks, points_px=tracks.points_px + noise))
    assert scene is given
    assert not report.refined


def test_a_camera_that_hardly_moves_is_left_alone() -> None:
    still = make_room(orbit(sweep_m=0.004), KEY_FRAMES)
    tracks = make_tracks(still, np.random.default_rng(0), per_element=30, sigma_px=0.3)
    for scene in (still.scene, with_cameras(still.scene, (still.scene.frames[0].camera,) * len(still.scene.frames))):
        same, report = refined(scene, tracks)
        assert same is scene
        assert report.kept_because == "the camera hardly moves"


def test_few_tracks_prove_nothing(simulated: Room) -> None:
    few = make_tracks(simulated, np.random.default_rng(0), per_element=3)
    given = disturbed(simulated.scene)
    scene, report = refined(given, few)
    assert scene is given
    assert f"only {len(few)} points" in report.kept_because


def test_frames_without_a_track_keep_their_pose(simulated: Room) -> None:
    near = make_tracks(simulated, np.random.default_rng(0), per_element=40, sigma_px=0.3, reach=2)
    given = jittered(simulated.scene, 0.15, 0.01)
    better, report = refined(given, near)
    assert report.refined
    seen = set(near.frame.tolist())
    assert len(seen) < len(given.frames)
    for f, (old, new) in enumerate(zip(given.frames, better.frames, strict=True)):
        assert (new is old) == (f not in seen)


def test_two_refinements_give_the_same_bytes(simulated: Room, tracks: Tracks) -> None:
    given = disturbed(simulated.scene)
    assert refined_cameras_text(refined(given, tracks)[0]) == refined_cameras_text(refined(given, tracks)[0])


def test_refined_cameras_are_read_back(tiny: Path, tmp_path: Path) -> None:
    scene = load_scene(tiny)
    moved = jittered(scene, 1.0, 0.1)
    assert with_refined_cameras(scene, tmp_path) is scene, "no file: the given cameras"
    (tmp_path / FILE).write_text(refined_cameras_text(moved))
    for frame, same in zip(moved.frames, with_refined_cameras(scene, tmp_path).frames, strict=True):
        np.testing.assert_allclose(same.camera.R_cam_from_world, frame.camera.R_cam_from_world, atol=1e-12)
        np.testing.assert_allclose(same.camera.t_cam_from_world, frame.camera.t_cam_from_world, atol=1e-12)
        assert same.image_path == frame.image_path
    zoomed = replace(moved.frames[0].camera, K=moved.frames[0].camera.K * np.array([[1.05], [1.05], [1.0]]))
    (tmp_path / FILE).write_text(refined_cameras_text(with_cameras(moved, (zoomed,) * len(moved.frames))))
    np.testing.assert_allclose(with_refined_cameras(scene, tmp_path).frames[-1].camera.K, zoomed.K, atol=1e-9)
    (tmp_path / FILE).write_text(refined_cameras_text(replace(moved, frames=moved.frames[1:])))
    with pytest.raises(GtlayoutError, match=f"no camera for {scene.frames[0].name}"):
        with_refined_cameras(scene, tmp_path)


def test_refined_cameras_are_a_camera_file(tiny: Path) -> None:
    moved = jittered(load_scene(tiny), 1.0, 0.1)
    (tiny / "transforms.json").write_text(refined_cameras_text(moved))
    for frame, same in zip(moved.frames, load_scene(tiny).frames, strict=True):
        np.testing.assert_allclose(same.camera.center_world, frame.camera.center_world, atol=1e-12)


def test_the_command_refines_writes_and_evaluates(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = Path(shutil.copytree(room, tmp_path / "scene")), tmp_path / "out"
    true = load_scene(folder)
    (folder / "transforms.json").write_text(refined_cameras_text(jittered(true, 0.2, 0.01)))
    given = load_scene(folder)
    assert main(["solve", str(folder), "--out", str(out), "--rerun", "save"]) == 0
    assert (out / "log.rrd").exists()
    assert "cameras refined: median 0." in capsys.readouterr().out
    assert json.loads((out / "config.json").read_text())["config"]["refine_cameras"] is True
    before, after = errors(given, true), errors(with_refined_cameras(given, out), true)
    assert after[0] < 0.9 * before[0]
    assert after[1] < 0.9 * before[1]
    # The figures are those of the cameras that the layout was solved with.
    solved = json.loads((out / "quality.json").read_text())["iou"]
    for same in (True, False):
        assert main(["evaluate", str(folder), "--layout", str(out), "--json"]) == 0
        iou = json.loads(capsys.readouterr().out)["iou"]
        assert (abs(iou - solved) < 1e-6) == same
        (out / FILE).unlink(missing_ok=True)


@pytest.mark.parametrize(
    ("report", "metric", "line"),
    [
        (CameraReport("", 0.137, 0.0088, 1.306, 0.923), True, "0.14° / 0.9 cm moved, points left out 1.31 → 0.92 px"),
        (CameraReport("", 0.137, 0.0088, 1.306, 0.923), False, "0.14° / 0.0088 units moved"),
        (CameraReport("the camera hardly moves"), True, "did not prove itself (the camera hardly moves)"),
    ],
)
def test_the_line_says_what_happened(report: CameraReport, metric: bool, line: str) -> None:
    assert line in camera_line(report, metric)
