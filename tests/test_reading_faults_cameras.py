"""Folders as people have them, made after real files and bug reports: what the command line makes of their cameras."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import SHARED_DATA

from gtlayout.cli.app import main
from gtlayout.io.scene_folder import load_scene, read_cameras

FAULTS = SHARED_DATA / "reading_faults"


def folder(name: str, tmp_path: Path) -> Path:
    """A copy, annotated: in its first frame, where it has no annotation."""
    if not (FAULTS / name).is_dir():
        pytest.skip(f"reading_faults/{name} is not beside the checkout")
    root = tmp_path / name
    shutil.copytree(FAULTS / name, root)
    if not (root / "annotations.json").exists():
        wall = {"id": "e0", "label": "wall", "polygons": [[[0, 0], [300, 0], [300, 100], [0, 100]]]}
        frames = [{"image": read_cameras(root)[1].images[0].name, "elements": [wall]}]
        data = {"format": "gtlayout-annotations/1", "image_size": [320, 240], "frames": frames}
        (root / "annotations.json").write_text(json.dumps(data))
    return root


def check(root: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What the command prints, on either stream."""
    main(["check", str(root)])
    captured = capsys.readouterr()
    return captured.out + captured.err


def test_is_fisheye(tmp_path: Path) -> None:
    """A corner ray is 22° from where a perspective lens would put it."""
    root = folder("is_fisheye", tmp_path)
    camera = read_cameras(root)[1].images[0].camera
    assert camera.model_name == "OPENCV_FISHEYE"
    x, y = camera.cam_from_img(np.array([0.0, 0.0]))
    perspective_deg = np.rad2deg(np.arctan(np.hypot(160, 120) / 250))
    assert np.rad2deg(np.arctan(np.hypot(x, y))) > perspective_deg + 4
    assert all(frame.undistort is not None for frame in load_scene(root).frames)


@pytest.mark.parametrize("name", ["last_row_float32", "colmap_names_with_spaces"])
def test_read_whole(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = folder(name, tmp_path)
    assert "4 frames" in check(root, capsys)
    assert load_scene(root).warnings == (
        "no visible parts drawn: points are tracked on whole elements, furniture before them too",
    )


def test_colmap_two_models(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = folder("colmap_two_models", tmp_path)
    text = check(root, capsys)
    assert "4 frames" in text
    assert f"{root / 'sparse/0'} (COLMAP) with 4 images was read, not {root / 'sparse/1'} (COLMAP) with 4" in text
    assert "choose with --cameras PATH" in text


def test_colmap_one_bad_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = folder("colmap_one_bad_name", tmp_path)
    text = check(root, capsys)
    assert "3 frames" in text
    assert "1 of 4 cameras cannot be used and were skipped" in text
    assert "the path ../other/3.jpg leads out of the scene folder" in text


def test_scannet_resized(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = folder("scannet_resized", tmp_path)
    for command in ("check", "solve"):
        assert main([command, str(root)]) == 1
        text = capsys.readouterr().err
        assert "the principal point (648.25, 484.25) lies outside of images of 640x480 px" in text
        assert "the intrinsics seem to be for images of about 1296x968 px; scale them" in text
    assert not (root / "gtlayout").exists()
