"""Polycam's raw export: corrected cameras first, sizes that differ, depth, and broken files."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from camera_formats import cameras_in_general_position, polycam

from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.images import read_depth
from gtlayout.io.scene_folder import load_scene

STEMS = [str(262195552056 + 1000 * i) for i in range(5)]


@pytest.fixture
def export(tmp_path: Path) -> Path:
    polycam(tmp_path, cameras_in_general_position())
    return tmp_path


def _edit(
    export: Path, stem: str, change: Callable[[dict[str, Any]], object], folder: str = "corrected_cameras"
) -> None:
    path = export / "keyframes" / folder / f"{stem}.json"
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


def test_arkit_axes(export: Path) -> None:
    """With camera-to-world = identity, ARKit's camera looks along -z, y up."""
    identity = {f"t_{row}{column}": float(row == column) for row in range(3) for column in range(4)}
    _edit(export, STEMS[0], lambda d: d.update(identity, fx=60, fy=60, cx=32, cy=24))
    scene = load_scene(export)
    pixels, depth = scene.frames[0].camera.project(np.array([[0.5, 0.25, -2.0]]))
    np.testing.assert_allclose(pixels, [[32 + 15, 24 - 7.5]])
    np.testing.assert_allclose(depth, [2.0])
    assert scene.metric
    assert scene.warnings == ()


def test_corrected_cameras_go_before_the_others(export: Path) -> None:
    keyframes = export / "keyframes"
    shutil.copytree(keyframes / "corrected_images", keyframes / "images")
    shutil.copytree(keyframes / "corrected_cameras", keyframes / "cameras")
    for stem in STEMS:
        _edit(export, stem, lambda d: d.update(fx=50), "cameras")
    assert load_scene(export).frames[0].camera.K[0, 0] == 61.25
    for file in (keyframes / "corrected_images").iterdir():
        file.unlink()
    scene = load_scene(export)
    assert "no corrected cameras" in scene.warnings[0]
    assert scene.frames[0].camera.K[0, 0] == 50
    assert scene.frames[0].image_path == keyframes / "images" / f"{STEMS[0]}.jpg"


def test_the_keyframes_folder_itself(export: Path) -> None:
    shutil.move(export / "annotations.json", export / "keyframes")
    assert len(load_scene(export / "keyframes").frames) == 5


def test_images_of_another_size(export: Path) -> None:
    """A camera for 128x96 px, images of 64x48."""
    for stem in STEMS:
        _edit(export, stem, lambda d: d.update(width=128, height=96, fx=120, fy=122, cx=61, cy=50))
    assert load_scene(export).frames[0].camera.K.tolist() == [[60, 0, 30.5], [0, 61, 25], [0, 0, 1]]


def test_images_of_another_shape(export: Path) -> None:
    _edit(export, STEMS[2], lambda d: d.update(width=64, height=64))
    scene = load_scene(export)
    assert len(scene.frames) == 4
    assert f"{STEMS[2]}.jpg: its camera is for images of 64x64 px, but this one is 64x48" in scene.warnings[0]


def test_newer_exports_say_the_size_elsewhere(export: Path) -> None:
    (export / "keyframes/cameras").mkdir()
    for stem in STEMS:
        (export / f"keyframes/cameras/{stem}.json").write_text('{"width": 128, "height": 96, "fx": 1}')
        _edit(export, stem, lambda d: [d.pop("width"), d.pop("height")])
    assert load_scene(export).frames[0].camera.K[0].tolist() == [61.25 / 2, 0, 30.5 / 2]


def test_depth(export: Path) -> None:
    """Smaller than the image and in millimetres; the image's lens, scaled."""
    depth_mm = np.full((24, 32), 1500, dtype=np.uint16)
    (export / "keyframes/depth").mkdir()
    (export / f"keyframes/depth/{STEMS[1]}.png").write_bytes(cv2.imencode(".png", depth_mm)[1].tobytes())
    scene = load_scene(export)
    assert [frame.depth_path is not None for frame in scene.frames] == [False, True, False, False, False]
    assert (read_depth(scene.frames[1]) == 1.5).all()


def test_bad_cameras_are_counted(export: Path) -> None:
    _edit(export, STEMS[0], lambda d: d.update(t_00=2.0))
    (export / f"keyframes/corrected_cameras/{STEMS[4]}.json").write_text("{")
    scene = load_scene(export)
    assert len(scene.frames) == 3
    first = export / "keyframes/corrected_cameras" / f"{STEMS[0]}.json"
    assert (
        f"2 of 5 cameras cannot be used and were skipped, first: {first}: the pose (t_00 to t_23)" in scene.warnings[0]
    )


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.pop("t_12"), "t_12 must be a finite number, not None"),
        (lambda d: d.update(fx=float("nan")), "fx must be a finite number, not nan"),
        (lambda d: d.update(fy=-60), "has no valid size and focal length"),
        (lambda d: d.update(width="64"), "width must be a finite number, not '64'"),
        (lambda d: d.update(width=64.5), "an image of 64.5x48 px is none"),
        (lambda d: [d.pop("width"), d.pop("height")], "cannot read .*keyframes/cameras/"),
    ],
)
def test_no_camera_can_be_used(export: Path, change: Callable[[dict[str, Any]], object], says: str) -> None:
    for stem in STEMS:
        _edit(export, stem, change)
    with pytest.raises(GtlayoutError, match=says):
        load_scene(export)


def test_no_images(export: Path) -> None:
    shutil.rmtree(export / "keyframes/corrected_images")
    shutil.copytree(export / "keyframes/corrected_cameras", export / "keyframes/cameras")
    with pytest.raises(GtlayoutError, match=rf"no image that can be read .*keyframes/images/{STEMS[0]}\.jpg"):
        load_scene(export)
