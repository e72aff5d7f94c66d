"""One set of cameras in every format: the same poses, and a point lands on the same sub-pixel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from camera_formats import FORMATS, HEIGHT, WIDTH, Write, cameras_in_general_position

from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import Camera


@pytest.mark.parametrize("write", FORMATS.values(), ids=FORMATS)
def test_the_same_cameras(tmp_path: Path, write: Write) -> None:
    cameras = cameras_in_general_position()
    write(tmp_path, cameras)
    scene = load_scene(tmp_path)
    assert scene.warnings == ()
    assert [key.frame for key in scene.key_frames] == [1, 3]
    for frame, camera in zip(scene.frames, cameras, strict=True):
        np.testing.assert_allclose(frame.camera.K, camera.K, atol=1e-9)
        np.testing.assert_allclose(frame.camera.R_cam_from_world, camera.R_cam_from_world, atol=1e-9)
        np.testing.assert_allclose(frame.camera.t_cam_from_world, camera.t_cam_from_world, atol=1e-9)


@pytest.mark.parametrize("write", FORMATS.values(), ids=FORMATS)
def test_a_point_lands_on_the_same_sub_pixel(tmp_path: Path, write: Write) -> None:
    """From the origin along z: on the axis to the middle of the image, which is a corner of four pixels."""
    K = np.array([[60.0, 0, WIDTH / 2], [0, 60.0, HEIGHT / 2], [0, 0, 1]])
    write(tmp_path, [Camera(K, np.eye(3), np.array([0.1 * i, 0, 0]), WIDTH, HEIGHT) for i in range(5)])
    pixels, depth = load_scene(tmp_path).frames[0].camera.project(np.array([[0, 0, 2.0], [0.5, -0.25, 3.0]]))
    np.testing.assert_allclose(pixels, [[32, 24], [42, 19]], atol=1e-9)
    np.testing.assert_allclose(depth, [2, 3], atol=1e-9)


def test_where_each_format_has_its_principal_point(tmp_path: Path) -> None:
    """What the files hold for a lens whose axis goes through the middle of 64x48 px."""
    K = np.array([[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]])
    cameras = [Camera(K, np.eye(3), np.array([0.1 * i, 0, 0]), WIDTH, HEIGHT) for i in range(5)]
    held = {
        "colmap_text": ("cameras.txt", "60 60 32 24"),
        "nerfstudio": ("transforms.json", '"cx": 32.0, "cy": 24.0'),
        "cad_estate": ("frames.json", "[60.0, 60.0, 32.0, 24.0]"),
        "scannet": ("intrinsic_color.txt", "60.0 0.0 31.5"),
        "seven_scenes": ("camera-intrinsics.txt", "60.0 0.0 32.0"),
        "arkitscenes": ("42446103_78067.083.pincam", "64 48 60.0 60.0 32.0 24.0"),
        "re10k": ("cameras.txt", "0 0.9375 1.25 0.5 0.5 0 0 1.0"),
        "polycam": ("262195552056.json", '"cx": 32.0, "cy": 24.0'),
    }
    for name, (file, text) in held.items():
        (written,) = (path for path in FORMATS[name](tmp_path / name, cameras) if path.name == file)
        assert text in written.read_text()
