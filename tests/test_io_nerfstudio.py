"""transforms.json as nerfstudio, instant-ngp and Blender write it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scene_checks import assert_one_camera_skipped

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.nerfstudio import read_transforms
from gtlayout.io.pixels.images import read_depth
from gtlayout.io.scene_folder import load_scene

Edit = Callable[[Path, Callable[[Any], object]], None]
LENS = ("fl_x", "fl_y", "cx", "cy", "w", "h")


def test_intrinsics_and_distortion_of_a_frame_go_before_the_files(tiny: Path, edit_json: Edit) -> None:
    own = {"fl_x": 70.0, "cx": 30.0, "k1": 0.01, "k2": -0.02, "p1": 0.001, "p2": 0.002}
    edit_json(tiny / "transforms.json", lambda d: [d.update(k1=0.5), d["frames"][1].update(own)])
    images = read_transforms(tiny, tiny / "transforms.json").images
    assert list(images[0].camera.params) == [60, 60, 32, 24, 0.5, 0, 0, 0]
    assert list(images[1].camera.params) == [70, 60, 30, 24, 0.01, -0.02, 0.001, 0.002]


def test_fisheye_of_one_frame(tiny: Path, edit_json: Edit) -> None:
    own = {"camera_model": "OPENCV_FISHEYE", "k1": 0.01, "k2": 0.02, "k3": 0.03, "k4": 0.04}
    edit_json(tiny / "transforms.json", lambda d: d["frames"][1].update(own))
    images = read_transforms(tiny, tiny / "transforms.json").images
    assert [image.camera.model for image in images[:2]] == ["OPENCV", "OPENCV_FISHEYE"]
    assert list(images[1].camera.params) == [60, 60, 32, 24, 0.01, 0.02, 0.03, 0.04]
    assert load_scene(tiny).frames[1].undistort is not None


def test_everything_in_the_frames(tiny: Path, edit_json: Edit) -> None:
    before = load_scene(tiny).frames

    def move(data: dict[str, Any]) -> None:
        own = {key: data.pop(key) for key in LENS}
        for frame in data["frames"]:
            frame.update(own)

    edit_json(tiny / "transforms.json", move)
    for a, b in zip(before, load_scene(tiny).frames, strict=True):
        np.testing.assert_array_equal(a.camera.K, b.camera.K)


def test_blender_file(tiny: Path, edit_json: Edit) -> None:
    """An angle of view, no size, names without extension: the size is the images'."""

    def as_blender(data: dict[str, Any]) -> None:
        for key in LENS:
            del data[key]
        data["camera_angle_x"] = 2 * math.atan(32 / 60)
        for i, frame in enumerate(data["frames"]):
            frame.update(file_path=f"./images/{i:03d}", rotation=0.01)

    edit_json(tiny / "transforms.json", as_blender)
    scene = load_scene(tiny)
    assert [frame.name for frame in scene.frames[:2]] == ["000.png", "001.png"]
    np.testing.assert_allclose(scene.frames[0].camera.K, [[60, 0, 32], [0, 60, 24], [0, 0, 1]])
    edit_json(tiny / "transforms.json", lambda d: d.update(camera_angle_y=2 * math.atan(24 / 50), cy=25))
    np.testing.assert_allclose(load_scene(tiny).frames[0].camera.K, [[60, 0, 32], [0, 50, 25], [0, 0, 1]])


def test_instant_ngp_focal_length_goes_before_the_angle(tiny: Path, edit_json: Edit) -> None:
    edit_json(tiny / "transforms.json", lambda d: d.update(camera_angle_x=0.5, camera_angle_y=0.4))
    assert load_scene(tiny).frames[0].camera.K[0, 0] == 60


def test_applied_transform_and_scale(tiny: Path, edit_json: Edit) -> None:
    """nerfstudio scaled the positions but not the depth maps: only divided do they fit; the axes stay the file's."""
    turn = [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]]
    before = load_scene(tiny).frames[3].camera.center_world
    edit_json(tiny / "transforms.json", lambda d: d.update(applied_scale=0.5, applied_transform=turn))
    np.testing.assert_allclose(load_scene(tiny).frames[3].camera.center_world, 2 * before)


def test_depth_file_path(tiny: Path, edit_json: Edit) -> None:
    """Millimetres, wherever the file says; a frame without has none."""
    (tiny / "lidar").mkdir()
    depth_mm = np.full((48, 64), 1250, dtype=np.uint16)
    (tiny / "lidar/a.png").write_bytes(cv2.imencode(".png", depth_mm)[1].tobytes())
    edit_json(tiny / "transforms.json", lambda d: d["frames"][1].update(depth_file_path="./lidar/a.png"))
    scene = load_scene(tiny)
    assert [frame.depth_path is not None for frame in scene.frames] == [False, True, False, False, False]
    assert (read_depth(scene.frames[1]) == 1.25).all()
    assert scene.metric


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["frames"][1].update(depth_file_path="../a.png"), "leads out of the scene folder"),
        (lambda d: d["frames"][1].update(depth_file_path=3), "depth_file_path must be a string"),
        (
            lambda d: d["frames"][1].update(file_path="a\nb.png"),
            r"frame a\\nb.png: the path .* characters that no name",
        ),
        (lambda d: d["frames"][1].update(file_path="a" * 5000), "is too long"),
    ],
)
def test_a_bad_frame_costs_only_itself(tiny: Path, edit_json: Edit, change: Callable[[Any], object], says: str) -> None:
    edit_json(tiny / "transforms.json", change)
    scene = load_scene(tiny)
    assert len(scene.frames) == 4
    assert_one_camera_skipped(scene.warnings, says)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.update(applied_scale=0), "applied_scale must be a positive number, not 0"),
        (lambda d: d.update(applied_scale=[1]), r"applied_scale must be a positive number, not \[1\]"),
        (lambda d: [d.pop("fl_x"), d.update(camera_angle_x=4)], "000.png has no valid size and focal length"),
        (lambda d: d.update(w=10**9), "an image of 1e.09x48 px is none"),
        (lambda d: d.update(fl_x=10**400), "fl_x must be a finite number, not inf"),
    ],
)
def test_bad_files(tiny: Path, edit_json: Edit, change: Callable[[Any], object], says: str) -> None:
    edit_json(tiny / "transforms.json", change)
    with pytest.raises(GtlayoutError, match=says) as caught:
        load_scene(tiny)
    assert str(caught.value).isprintable()
