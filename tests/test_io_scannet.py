"""ScanNet exports and the layout of 7-Scenes and 3DMatch, written by the exporter (or by hand) and read back."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from scene_checks import assert_one_camera_skipped

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.scannet import write_scannet
from gtlayout.io.pixels.images import read_depth
from gtlayout.io.pixels.registration import Pinhole, Registration
from gtlayout.io.pixels.turn import TURNS
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import read_truth
from gtlayout.io.writing.scene_writers import write_scene
from gtlayout.scene import Scene

SENSOR = Pinhole(np.array([[33.0, 0, 17.25], [0, 29.0, 11.5], [0, 0, 1]]), 34, 23)


@pytest.fixture
def export(tiny: Path, tmp_path: Path) -> Path:
    """The tiny scene as an export, in a folder of its own; depth for two frames, by a sensor of half the size."""
    (tiny / "depth").mkdir()
    ramp = np.round(2000 + 5 * np.arange(64) + 3 * np.arange(48)[:, None]).astype(np.uint16)
    for i in (1, 3):
        (tiny / f"depth/{i:03d}.png").write_bytes(cv2.imencode(".png", ramp)[1].tobytes())
    scene = _turned(load_scene(tiny))
    write_scene(scene, tmp_path / "export", "scannet", "native")
    write_scannet(scene, tmp_path / "export", SENSOR)
    return tmp_path / "export"


def test_cameras_come_back(tiny: Path, export: Path) -> None:
    scene, read = _turned(load_scene(tiny)), load_scene(export)
    assert read.warnings == ()
    assert read.metric
    assert [frame.name for frame in read.frames] == [f"{i}.jpg" for i in range(5)]
    for a, b in zip(scene.frames, read.frames, strict=True):
        np.testing.assert_allclose(b.camera.K, a.camera.K, atol=1e-9)
        np.testing.assert_allclose(b.camera.R_cam_from_world, a.camera.R_cam_from_world, atol=1e-9)
        np.testing.assert_allclose(b.camera.t_cam_from_world, a.camera.t_cam_from_world, atol=1e-9)
    assert [key.frame for key in read.key_frames] == [1, 3]
    assert read.key_frames[0].elements[0].amodal.equals(scene.key_frames[0].elements[0].amodal)


def test_intrinsics_count_from_pixel_centres(export: Path) -> None:
    """319.5 of 640 is the middle there: half a pixel less than here."""
    in_file = np.loadtxt(export / "intrinsic/intrinsic_color.txt")
    np.testing.assert_allclose(load_scene(export).frames[0].camera.K[:2, 2] - in_file[:2, 2], 0.5)


def test_depth_is_seen_through_the_image_camera(room: Path, tmp_path: Path) -> None:
    """Depth of half the size and another principal point says the same of every plane."""
    scene = load_scene(room)
    K = scene.frames[0].camera.K.copy()
    K[:2] *= 0.5
    K[:2, 2] += (5, -3)
    write_scene(scene, tmp_path / "export", "scannet", "native")
    write_scannet(scene, tmp_path / "export", Pinhole(K, 180, 110))
    read = load_scene(tmp_path / "export")
    for k in range(len(scene.key_frames)):
        before, after = read_depth(scene.frame_of(k)), read_depth(read.frame_of(k))
        assert after.shape == before.shape
        error_m = np.abs(after - before)
        assert np.isfinite(after).mean() > 0.8
        assert np.nanmedian(error_m) <= 0.001
        # Edges of furniture, and the floor at so small a size.
        assert np.mean(error_m > 0.02) < 0.1


def test_registration_of_planes_is_exact() -> None:
    """1/z is linear in the image, whatever the size of its pixels."""
    source = Pinhole(np.array([[300.0, 0, 160], [0, 310.0, 120], [0, 0, 1]]), 320, 240)
    target = Pinhole(np.array([[590.0, 0, 322], [0, 600.0, 236], [0, 0, 1]]), 640, 480)
    depth = Registration(source, target)(_plane_mm(source))
    expected = _plane_mm(target).astype(int)
    assert (depth > 0).mean() > 0.95
    # The outermost half pixel of the source has no neighbours to be between.
    within = (slice(12, -12), slice(16, -16))
    assert np.abs(depth - expected)[within].max() <= 2


def test_registration_keeps_depth_edges_and_holes() -> None:
    source = Pinhole(np.array([[10.0, 0, 4], [0, 10.0, 2], [0, 0, 1]]), 8, 4)
    target = Pinhole(np.array([[30.0, 0, 15], [0, 30.0, 6], [0, 0, 1]]), 30, 12)
    depth = np.full((4, 8), 1000, dtype=np.uint16)
    depth[:, 4:] = 3000
    depth[0] = 0
    seen = Registration(source, target)(depth)
    assert set(np.unique(seen)) == {0, 1000, 3000}
    assert (seen[:3] == 0).all()
    # The source ends three pixels of the target before its border: (15 - 12) px on both sides.
    assert seen[6].tolist() == [0] * 3 + [1000] * 12 + [3000] * 12 + [0] * 3
    with pytest.raises(GtlayoutError, match="8x5 px, its camera says 8x4"):
        Registration(source, target)(np.zeros((5, 8), dtype=np.uint16))


def test_lost_poses_are_skipped_and_counted(export: Path) -> None:
    (export / "pose/2.txt").write_text("-inf -inf -inf -inf\n" * 4)
    read = load_scene(export)
    assert [frame.name for frame in read.frames] == ["0.jpg", "1.jpg", "3.jpg", "4.jpg"]
    assert read.warnings[0].startswith("1 of 5 frames lost their pose and were skipped, first ")


def test_depth_from_another_place_is_left_out(export: Path) -> None:
    moved = np.eye(4)
    moved[0, 3] = 0.04
    np.savetxt(export / "intrinsic/extrinsic_depth.txt", moved)
    read = load_scene(export)
    assert any("depth left out" in warning for warning in read.warnings)
    assert all(frame.depth_path is None for frame in read.frames)
    assert read.metric


def test_saturated_depth_is_none(export: Path) -> None:
    depth = np.full((23, 34), 65535, dtype=np.uint16)
    (export / "depth/1.png").write_bytes(cv2.imencode(".png", depth)[1].tobytes())
    assert not np.isfinite(read_depth(load_scene(export).frame_of(0))).any()


@pytest.mark.parametrize("place", [".", ".."])
def test_seven_scenes(export: Path, tmp_path: Path, place: str) -> None:
    """The same frames as frame-000000.color.jpg and so on, with one 3x3 intrinsics file, here or above."""
    before = load_scene(export)
    scene = tmp_path / "redkitchen" / "seq-01"
    scene.mkdir(parents=True)
    shutil.copy(export / "annotations.json", scene)
    text = (scene / "annotations.json").read_text()
    for i in range(5):
        shutil.copy(export / f"color/{i}.jpg", scene / f"frame-{i:06d}.color.jpg")
        shutil.copy(export / f"pose/{i}.txt", scene / f"frame-{i:06d}.pose.txt")
        text = text.replace(f'"{i}.jpg"', f'"frame-{i:06d}.color.jpg"')
    (scene / "annotations.json").write_text(text)
    depth = np.full((48, 64), 1500, dtype=np.uint16)
    (scene / "frame-000001.depth.png").write_bytes(cv2.imencode(".png", depth)[1].tobytes())
    np.savetxt(scene / place / "camera-intrinsics.txt", before.frames[0].camera.K)
    read = load_scene(scene)
    assert read.metric
    for a, b in zip(before.frames, read.frames, strict=True):
        np.testing.assert_allclose(b.camera.K, a.camera.K, atol=1e-9)
        np.testing.assert_allclose(b.camera.center_world, a.camera.center_world, atol=1e-9)
    assert (read_depth(read.frame_of(0)) == 1.5).all()
    assert read.frame_of(1).depth_path is None


def test_truth_goes_along(room: Path, tmp_path: Path) -> None:
    scene = load_scene(room)
    write_scene(scene, tmp_path / "export", "scannet", "native")
    before, after = read_truth(scene), read_truth(load_scene(tmp_path / "export"))
    assert before is not None
    assert after is not None
    assert after.elements == before.elements


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (lambda r: (r / "pose/3.txt").write_text("1 2 x"), "3.txt must hold 4x4 numbers"),
        (lambda r: np.savetxt(r / "pose/3.txt", np.diag([2, 2, 2, 1])), "3.txt: .*no rotation"),
    ],
)
def test_a_bad_pose_costs_only_itself(export: Path, break_it: Callable[[Path], object], says: str) -> None:
    break_it(export)
    scene = load_scene(export)
    assert len(scene.frames) == 4
    assert_one_camera_skipped(scene.warnings, says)


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (lambda r: (r / "intrinsic/intrinsic_color.txt").unlink(), "cannot read .*intrinsic_color.txt"),
        (lambda r: (r / "intrinsic/intrinsic_color.txt").write_text("1 2 3"), "intrinsic_color.txt must hold 4x4"),
        (
            lambda r: np.savetxt(r / "intrinsic/intrinsic_depth.txt", np.zeros((4, 4))),
            "intrinsic_depth.txt holds no pin",
        ),
        (lambda r: [(r / f"pose/{i}.txt").write_text("-inf " * 16) for i in range(5)], "no pose of 5 frames"),
        (lambda r: shutil.rmtree(r / "color"), "no image file that can be read .*0.jpg"),
        (lambda r: (r / "annotations.json").unlink(), "no annotations in"),
    ],
)
def test_incomplete_export(export: Path, break_it: Callable[[Path], object], says: str) -> None:
    break_it(export)
    with pytest.raises(GtlayoutError, match=says) as caught:
        load_scene(export)
    assert "\n" not in str(caught.value)


def test_exporter_refuses_what_the_format_cannot_say(tiny: Path, tmp_path: Path) -> None:
    scene = load_scene(tiny)
    with pytest.raises(GtlayoutError, match="unit is the metre"):
        write_scannet(scene, tmp_path / "export")
    other = replace(scene.frames[1].camera, K=2 * scene.frames[1].camera.K)
    frames = (scene.frames[0], replace(scene.frames[1], camera=other), *scene.frames[2:])
    with pytest.raises(GtlayoutError, match="knows one camera"):
        write_scannet(replace(scene, frames=frames, metric=True), tmp_path / "export")


def _turned(scene: Scene) -> Scene:
    """Poses in general position, and intrinsics that are no round numbers."""
    rng = np.random.default_rng(2)
    K = np.array([[61.25, 0, 30.5], [0, 62.75, 25.125], [0, 0, 1]])
    frames = []
    for frame in scene.frames:
        rotation = cv2.Rodrigues(rng.normal(size=3))[0].astype(np.float64)
        camera = replace(frame.camera, K=K, R_cam_from_world=rotation, t_cam_from_world=rng.normal(size=3))
        frames.append(replace(frame, camera=camera))
    return replace(scene, frames=tuple(frames))


def _plane_mm(camera: Pinhole) -> np.ndarray:
    """Depth of a slanted plane three metres off."""
    x = (np.arange(camera.width) + 0.5 - camera.K[0, 2]) / camera.K[0, 0]
    y = (np.arange(camera.height) + 0.5 - camera.K[1, 2]) / camera.K[1, 1]
    return np.rint(3000 / (1 + 0.5 * x - 0.3 * y[:, None])).astype(np.uint16)


def test_depth_of_a_sensor_of_its_own_turns_with_a_tagged_image(export: Path) -> None:
    before = load_scene(export, annotated=False).frames[1]
    for path in sorted((export / "color").iterdir()):
        with Image.open(path) as image:
            exif = Image.Exif()
            exif[0x112] = 6
            image.save(path, exif=exif)
    after = load_scene(export, annotated=False).frames[1]
    assert (after.camera.width, after.camera.height) == (before.camera.height, before.camera.width)
    np.testing.assert_array_equal(read_depth(after), TURNS[5].image(read_depth(before)))
