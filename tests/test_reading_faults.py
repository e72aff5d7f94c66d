"""Folders as people have them, made after real files and bug reports: what the command line makes of each."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import SHARED_DATA

from gtlayout.cli.app import main
from gtlayout.io.pixels.images import decode, read_rgb
from gtlayout.io.scene_folder import load_scene, read_cameras

FAULTS = SHARED_DATA / "reading_faults"
NO_VISIBLE = "no visible parts drawn: points are tracked on whole elements, furniture before them too"
"""True of all of them, and no fault."""
DRAWN_PX = (0, 0, 300, 100)
"""The one wall that all of them have."""


def folder(name: str, tmp_path: Path) -> Path:
    """A copy, annotated: in its first frame, where it has no annotation."""
    if not FAULTS.is_dir():
        pytest.skip("shared/data/reading_faults is not beside the checkout")
    root = tmp_path / name
    shutil.copytree(FAULTS / name, root)
    return root


def annotated(root: Path) -> Path:
    """The folder with a wall drawn in its first frame."""
    wall = {"id": "e0", "label": "wall", "polygons": [[[0, 0], [300, 0], [300, 100], [0, 100]]]}
    frames = [{"image": read_cameras(root)[1].images[0].name, "elements": [wall]}]
    data = {"format": "gtlayout-annotations/1", "image_size": [320, 240], "frames": frames}
    (root / "annotations.json").write_text(json.dumps(data))
    return root


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """The exit status, and what the command prints, on either stream."""
    capsys.readouterr()
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return status, captured.out + captured.err


def test_every_folder_has_its_test() -> None:
    if not FAULTS.is_dir():
        pytest.skip("shared/data/reading_faults is not beside the checkout")
    tested = Path(__file__).read_text()
    assert [path.name for path in sorted(FAULTS.iterdir()) if path.is_dir() and f'"{path.name}"' not in tested] == []


@pytest.mark.parametrize(
    ("name", "frame"),
    [
        ("bom_json", None),
        ("last_row_float32", None),
        ("colmap_names_with_spaces", None),
        ("labelme_imagedata_first", "000000.jpg"),
        ("folder_suffix", "cam0/000000.jpg"),
        ("nfd_nfc", "Ku\u0308che0.jpg"),
        ("annotations_option_ignored", "000000.jpg"),
    ],
)
def test_read_whole(name: str, frame: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``frame``: the one that is drawn in; None where none is yet."""
    root = folder(name, tmp_path)
    status, text = run(capsys, "import", root, tmp_path / "out")
    assert status == 0
    assert ("not annotated yet" in text) == (frame is None)
    assert [line for line in text.splitlines() if line.startswith("warning") and NO_VISIBLE not in line] == []
    if frame is None:
        annotated(root)
    status, text = run(capsys, "check", root)
    assert status == 3  # Its images hold one picture.
    assert "4 frames, 1 key frames, 1 elements" in text
    scene = load_scene(root)
    assert scene.warnings == (NO_VISIBLE,)
    assert scene.frame_of(0).name == (frame or scene.frames[0].name)
    assert scene.key_frames[0].elements[0].amodal.bounds == DRAWN_PX


def test_is_fisheye(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A corner ray is 22° from where a perspective lens would put it."""
    root = folder("is_fisheye", tmp_path)
    camera = read_cameras(root)[1].images[0].camera
    assert camera.model == "OPENCV_FISHEYE"
    x, y = camera.rays(np.array([[0.0, 0.0]]))[0]
    perspective_deg = np.rad2deg(np.arctan(np.hypot(160, 120) / 250))
    assert np.rad2deg(np.arctan(np.hypot(x, y))) > perspective_deg + 4
    assert run(capsys, "import", root, tmp_path / "out")[0] == 0
    stored = decode(root / "images/000000.jpg", cv2.IMREAD_COLOR_RGB)
    undistorted = read_rgb(load_scene(tmp_path / "out").frames[0])
    assert undistorted.shape != stored.shape or np.abs(undistorted.astype(int) - stored).mean() > 1


def test_cvat_video_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = folder("cvat_video_numbers", tmp_path)
    for command in (["check", root], ["import", root, tmp_path / "out"]):
        text = run(capsys, *command)[1]
        assert text.count("annotations.xml: its images are numbers of 240 frames, the scene has 16 images") == 1
        assert "matched by the numbers in the names, frame_000008 is frame_000008.jpg" in text
    assert [key_frame.frame for key_frame in load_scene(root).key_frames] == [7, 14]


def test_exif_180(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Drawn on the image as shown, upside down as stored: import writes both upright."""
    root = folder("exif_180", tmp_path)
    for command in (["check", root], ["import", root, tmp_path / "out"]):
        text = run(capsys, *command)[1]
        assert "4 images have an orientation tag (EXIF): turned by 180° when shown" in text
        assert "annotations.xml: 1 annotated images have an orientation tag (EXIF), first 000000.jpg: they were" in text
    scene = load_scene(tmp_path / "out")
    assert not any("orientation" in line for line in scene.warnings)
    assert scene.key_frames[0].elements[0].amodal.bounds == (20, 140, 320, 240)
    stored = decode(root / "images/000000.jpg", cv2.IMREAD_COLOR_RGB)
    assert np.abs(read_rgb(scene.frames[0]).astype(int) - stored[::-1, ::-1]).mean() < 5  # coded anew


def test_annotations_option_ignored(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root, out = folder("annotations_option_ignored", tmp_path), tmp_path / "out"
    for option in ("annotations.txt", root / "annotations.txt"):
        status, text = run(capsys, "import", root, out, "--annotations", option)
        assert status == 1
        assert "annotations.txt is no file of a known tool" in text
        assert not out.exists()
    for number, zipped in enumerate(("cvat_export.zip", root / "cvat_export.zip")):
        status, text = run(capsys, "import", root, f"{out}{number}", "--annotations", zipped)
        assert status == 0
        assert "not annotated yet" not in text
        assert len(load_scene(Path(f"{out}{number}")).key_frames) == 1


def test_colmap_two_models(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = annotated(folder("colmap_two_models", tmp_path))
    text = run(capsys, "check", root)[1]
    assert "4 frames" in text
    assert f"{root / 'sparse/0'} (COLMAP) with 4 images was read, not {root / 'sparse/1'} (COLMAP) with 4" in text
    assert "choose with --cameras PATH" in text
    assert "was read, not" not in run(capsys, "check", root, "--cameras", "sparse/1")[1]


def test_colmap_one_bad_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = annotated(folder("colmap_one_bad_name", tmp_path))
    text = run(capsys, "check", root)[1]
    assert "3 frames" in text
    assert "1 of 4 cameras cannot be used and were skipped" in text
    assert "the path ../other/3.jpg leads out of the scene folder" in text


def test_scannet_resized(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = folder("scannet_resized", tmp_path)
    for command in (["check", root], ["solve", root], ["import", root, tmp_path / "out"]):
        status, text = run(capsys, *command)
        assert status == 1
        assert "the principal point (648.25, 484.25) lies outside of images of 640x480 px" in text
        assert "the intrinsics seem to be for images of about 1296x968 px; scale them" in text
    assert not (root / "gtlayout").exists()
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "reasons"),
    [
        ("ls_keypoint_rectangle", ["region skipped: it is of type keypoint, not polygon"]),
        ("no_reason_cvat", ["points skipped: it is no polygon", "tag skipped: it is no polygon"]),
    ],
)
def test_reasons(name: str, reasons: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = folder(name, tmp_path)
    for command in (["check", root], ["import", root, tmp_path / "out"]):
        status, text = run(capsys, *command)
        assert status == 1
        assert "no usable element in any frame" in text
        assert all(text.count(reason) == 1 for reason in reasons)


def test_images_silently_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Cameras are found for all that can be decoded; the .HEIC holds nothing."""
    root = folder("images_silently_left_out", tmp_path)
    status, text = run(capsys, "import", root, tmp_path / "out", "--colmap")
    assert status == 0
    assert "17 of 17 frames registered" in text
    (line,) = [line for line in text.splitlines() if "left out" in line]
    assert line.endswith(": IMG_0017.HEIC")
    assert sum(frame.name.startswith("IMG_00") for frame in load_scene(tmp_path / "out", annotated=False).frames) == 17


def test_colmap_heic_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, text = run(capsys, "import", folder("colmap_heic_only", tmp_path), tmp_path / "out", "--colmap")
    assert status == 1
    assert "holds no image that can be read; left out (" in text
    assert text.rstrip().endswith("IMG_0.HEIC, IMG_1.HEIC, IMG_2.HEIC, IMG_3.HEIC")
    assert not (tmp_path / "out").exists()
