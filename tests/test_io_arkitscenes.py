"""ARKitScenes scans: which images, which intrinsics, which depth, and what is wrong with a broken one."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_formats import arkitscenes, cameras_in_general_position

from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.images import read_depth
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import FloatArray

SCAN = "42446103"


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    arkitscenes(tmp_path, cameras_in_general_position())
    return tmp_path


def _png(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(cv2.imencode(".png", image)[1].tobytes())


def test_the_documented_example(tmp_path: Path) -> None:
    """A quarter turn about y: what world-to-camera means, with camera axes right, down, forward."""
    arkitscenes(tmp_path, cameras_in_general_position())
    line = "78067.083 0 1.5707963267948966 0 0.5 0 3"
    rest = (tmp_path / "lowres_wide.traj").read_text().splitlines()[1:]
    (tmp_path / "lowres_wide.traj").write_text("\n".join([line, *rest]))
    camera = load_scene(tmp_path).frames[0].camera
    np.testing.assert_allclose(camera.R_cam_from_world @ [0, 0, 1], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(camera.center_world, [3, 0, -0.5], atol=1e-12)


def test_a_scan_is_metric(scan: Path) -> None:
    scene = load_scene(scan)
    assert scene.metric
    assert scene.warnings == ()
    assert scene.frames[0].name == f"{SCAN}_78067.083.png"


def test_the_folder_of_3dod(scan: Path) -> None:
    frames = scan / f"{SCAN}_frames"
    frames.mkdir()
    for path in list(scan.iterdir()):
        if path not in (frames, scan / "annotations.json"):
            shutil.move(path, frames)
    assert load_scene(scan).frames[0].image_path == frames / "lowres_wide" / f"{SCAN}_78067.083.png"


def test_larger_images_go_before_smaller_ones(scan: Path) -> None:
    """vga_wide has pose and intrinsics; wide has images, but the release holds no intrinsics for them."""
    for file in sorted((scan / "lowres_wide").iterdir()):
        _png(scan / "vga_wide" / file.name, np.zeros((96, 128, 3), dtype=np.uint8))
        _png(scan / "wide" / file.name, np.zeros((288, 384, 3), dtype=np.uint8))
        (scan / "vga_wide_intrinsics").mkdir(exist_ok=True)
        (scan / "vga_wide_intrinsics" / f"{file.stem}.pincam").write_text("128 96 120 121 63 49")
    text = (scan / "annotations.json").read_text().replace("[64, 48]", "[128, 96]", 1)
    (scan / "annotations.json").write_text(text)
    camera = load_scene(scan).frames[2].camera
    assert (camera.width, camera.height) == (128, 96)
    np.testing.assert_allclose(camera.K, [[120, 0, 63], [0, 121, 49], [0, 0, 1]])


def test_images_between_poses_are_counted(scan: Path) -> None:
    """60 images a second, 10 poses."""
    file = scan / "lowres_wide" / f"{SCAN}_78067.183.png"
    for time in ("78067.100", "78067.116", "78067.181"):
        shutil.copy(file, file.with_name(f"{SCAN}_{time}.png"))
    scene = load_scene(scan)
    assert len(scene.frames) == 5
    (warning,) = scene.warnings
    assert f"3 of 8 images of {scan / 'lowres_wide'} were skipped, {SCAN}_78067.100.png: no pose within 1 ms" in warning


def test_intrinsics_are_those_nearest_in_time(scan: Path) -> None:
    folder = scan / "lowres_wide_intrinsics"
    (folder / f"{SCAN}_78067.183.pincam").rename(folder / f"{SCAN}_78067.200.pincam")
    (folder / f"{SCAN}_78067.200.pincam").write_text("64 48 70 70 32 24")
    (folder / f"{SCAN}_78067.083.pincam").unlink()
    (folder / f"{SCAN}_78067.483.pincam").write_text("64 48 70 70")
    scene = load_scene(scan)
    assert [frame.camera.K[0, 0] for frame in scene.frames] == [70, 61.25, 61.25]
    assert "2 of 5 images" in scene.warnings[0]
    assert f"{SCAN}_78067.083.png: no .pincam" in scene.warnings[0]


def test_depth_has_a_camera_of_its_own(scan: Path) -> None:
    """Half as large: a plane's depth comes out in metres on the image's grid, and one map is missing."""
    K: FloatArray = np.array([[30.0, 0, 15.25], [0, 31.0, 12.5], [0, 0, 1]])
    _vga(scan)
    for time in ("78067.183", "78067.382"):
        (scan / "lowres_wide_intrinsics" / f"{SCAN}_{time}.pincam").write_text("32 24 30 31 15.25 12.5")
        x = (np.arange(32) + 0.5 - K[0, 2]) / K[0, 0]
        _png(
            scan / "lowres_depth" / f"{SCAN}_{time}.png",
            np.rint(3000 / (1 + 0.5 * x)).astype(np.uint16)[None].repeat(24, 0),
        )
    scene = load_scene(scan)
    assert [frame.depth_path is not None for frame in scene.frames] == [False, True, False, True, False]
    frame = scene.frames[1]
    depth = read_depth(frame)
    assert depth.shape == (48, 64)
    x = (np.arange(64) + 0.5 - frame.camera.K[0, 2]) / frame.camera.K[0, 0]
    inside = np.isfinite(depth[24])
    assert inside.sum() > 50
    np.testing.assert_allclose(depth[24][inside], (3 / (1 + 0.5 * x))[inside], atol=0.05)
    np.testing.assert_allclose(depth[24][12:50], (3 / (1 + 0.5 * x))[12:50], atol=0.002)


def test_depth_without_intrinsics_is_left_out(scan: Path) -> None:
    _vga(scan)
    shutil.rmtree(scan / "lowres_wide_intrinsics")
    _png(scan / "lowres_depth" / f"{SCAN}_78067.183.png", np.full((24, 32), 1500, dtype=np.uint16))
    scene = load_scene(scan)
    assert all(frame.depth_path is None for frame in scene.frames)
    assert "lowres_depth was left out" in scene.warnings[0]


def test_bad_lines_are_counted(scan: Path) -> None:
    path = scan / "lowres_wide.traj"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(["1 2 3", *lines[:4], "78067.483 nan 0 0 0 0 0", "78067.483 1e300 0 0 0 0 0"]))
    scene = load_scene(scan)
    assert len(scene.frames) == 4
    assert "3 lines are no pose and were skipped, first line 1" in scene.warnings[0]


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (lambda s: (s / "lowres_wide.traj").write_text(""), "lowres_wide.traj holds no pose"),
        (lambda s: (s / "lowres_wide.traj").write_bytes(b"\xff\xfe"), "lowres_wide.traj is not a text file"),
        (lambda s: shutil.rmtree(s / "lowres_wide"), "has no images; looked for wide, vga_wide, lowres_wide"),
        (lambda s: shutil.rmtree(s / "lowres_wide_intrinsics"), r"no image has a pose and intrinsics; .*no \.pincam"),
        (lambda s: (s / "lowres_wide.traj").write_text("1 0 0 0 0 0 0"), "no image has a pose .*no pose within 1 ms"),
        (
            lambda s: [p.write_text("64 48 0 60 32 24") for p in (s / "lowres_wide_intrinsics").iterdir()],
            "no image has a pose and intrinsics; .*pincam has no valid size and focal length",
        ),
    ],
)
def test_broken_scans(scan: Path, break_it: Callable[[Path], object], says: str) -> None:
    break_it(scan)
    with pytest.raises(GtlayoutError, match=says):
        load_scene(scan)


def _vga(scan: Path) -> None:
    """The images as vga_wide, so that depth and image differ in their cameras."""
    (scan / "lowres_wide").rename(scan / "vga_wide")
    shutil.copytree(scan / "lowres_wide_intrinsics", scan / "vga_wide_intrinsics")
    assert json.loads((scan / "annotations.json").read_text())["image_size"] == [64, 48]
