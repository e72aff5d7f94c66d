"""Orientation tags (EXIF): what they mean, and what becomes of images, cameras and drawings that have one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from exif import shown_rgb, write_tagged
from PIL import Image, ImageOps

from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.images import decode, read_depth, read_rgb
from gtlayout.io.pixels.turn import TURNS, read_header
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import Camera, ImageArray, Scene

Edit = Callable[[Path, Callable[[Any], object]], None]
ALL = range(1, 9)
PROPER, MIRRORED, SIDEWAYS = (3, 6, 8), (2, 4, 5, 7), (5, 6, 7, 8)


def picture(width: int = 64, height: int = 48) -> ImageArray:
    """A different colour in every corner, large enough to survive JPEG."""
    image = np.full((height, width, 3), 128, dtype=np.uint8)
    image[:16, :16], image[:16, -16:], image[-16:, :16] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    return image


@pytest.mark.parametrize("orientation", ALL)
def test_turns_mean_what_pillow_and_opencv_make_of_the_tag(orientation: int, tmp_path: Path) -> None:
    path = write_tagged(tmp_path / "a.png", picture(), orientation)
    assert np.array_equal(shown_rgb(path), picture())
    with Image.open(path) as image:
        assert np.array_equal(np.array(ImageOps.exif_transpose(image)), picture())


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".tif"])
@pytest.mark.parametrize("orientation", ALL)
def test_headers_and_pixels_are_as_stored(suffix: str, orientation: int, tmp_path: Path) -> None:
    path = write_tagged(tmp_path / f"a{suffix}", picture(), orientation)
    header, pixels = read_header(path), decode(path, cv2.IMREAD_COLOR_RGB)
    assert header is not None
    assert header.turn == TURNS[orientation - 1]
    assert header.size == ((48, 64) if orientation in SIDEWAYS else (64, 48))
    assert header.size == pixels.shape[1::-1]
    assert np.abs(header.turn.image(pixels).astype(int) - picture()).mean() < 4


@pytest.mark.parametrize("content", [b"", b"no image", b"\xff\xd8\xff\xe1\x00\x10Exif\x00\x00II*\x00\xff\xff\xff\xff"])
def test_what_has_no_header_has_no_orientation(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(content)
    assert read_header(tmp_path / "a.jpg") is None
    assert read_header(tmp_path / "nowhere.jpg") is None


@pytest.mark.parametrize("value", [0, 9, 65535])
def test_orientations_that_do_not_exist_count_as_none(value: int, tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x112] = value
    Image.fromarray(picture()).save(tmp_path / "a.jpg", exif=exif)
    header = read_header(tmp_path / "a.jpg")
    assert header is not None
    assert header.turn == TURNS[0]


@pytest.mark.parametrize("orientation", ALL)
def test_points_turn_with_their_pixels_and_back(orientation: int) -> None:
    turn, stored = TURNS[orientation - 1], np.zeros((48, 64), dtype=np.uint8)
    stored[10, 50] = 1
    (row,), (column,) = np.nonzero(turn.image(stored))
    shown_px = turn.points(np.array([[50.5, 10.5]]), (64, 48))
    np.testing.assert_allclose(shown_px, [[column + 0.5, row + 0.5]])
    np.testing.assert_allclose(turn.inverse.points(shown_px, turn.size((64, 48))), [[50.5, 10.5]])


@pytest.mark.parametrize("orientation", PROPER)
def test_cameras_turn_with_their_image(orientation: int) -> None:
    turn = TURNS[orientation - 1]
    K = np.array([[60.0, 0, 30], [0, 55.0, 20], [0, 0, 1]])
    stored = Camera(K, np.eye(3), np.array([0.1, 0.2, 0.3]), 64, 48)
    shown = turn.camera(stored)
    points_world = np.array([[0.3, -0.1, 2.0], [-0.5, 0.4, 3.0]])
    assert np.linalg.det(shown.R_cam_from_world) == pytest.approx(1)
    assert (shown.width, shown.height) == turn.size((64, 48))
    np.testing.assert_allclose(
        shown.project(points_world)[0], turn.points(stored.project(points_world)[0], (64, 48)), atol=1e-9
    )


def tag_all(root: Path, orientation: int) -> list[ImageArray]:
    """Give the stored pixels of the scene's images a tag; returns what is stored."""
    stored = []
    for path in sorted((root / "images").iterdir()):
        pixels = decode(path, cv2.IMREAD_COLOR_RGB)
        exif = Image.Exif()
        exif[0x112] = orientation
        Image.fromarray(pixels).save(path, exif=exif)
        stored.append(pixels.astype(np.uint8))
    return stored


def lens(edit_json: Edit, root: Path) -> None:
    edit_json(root / "transforms.json", lambda d: d.update(k1=-0.05, k2=0.01, cx=30.0))


def shown_size(orientation: int) -> list[int]:
    return [48, 64] if orientation in SIDEWAYS else [64, 48]


@pytest.mark.parametrize("with_lens", [False, True])
@pytest.mark.parametrize("orientation", ALL)
def test_what_is_drawn_on_the_shown_image_stays_on_its_pixels_and_on_its_rays(
    tiny: Path, edit_json: Edit, orientation: int, with_lens: bool
) -> None:
    if with_lens:
        lens(edit_json, tiny)
    before = load_scene(tiny)
    stored = tag_all(tiny, orientation)
    turn = TURNS[orientation - 1]
    corner_px = np.array([[10.0, 5.0], [40.0, 5.0], [40.0, 20.0], [10.0, 20.0]])
    polygon = turn.points(corner_px, (64, 48)).tolist()
    edit_json(
        tiny / "annotations.json",
        lambda d: [
            d.update(image_size=shown_size(orientation)),
            *(f["elements"][0].update(polygons=[polygon], visible=[]) for f in d["frames"]),
        ],
    )
    edit = json.loads((tiny / "annotations.json").read_text())
    assert edit["image_size"] == shown_size(orientation)
    scene = load_scene(tiny)
    frame, reference = scene.frame_of(0), before.frame_of(0)
    # The same drawing on the stored pixels, in the scene without tags.
    drawn_stored_px = corner_px if reference.undistort is None else reference.undistort.points(corner_px)  # type: ignore[attr-defined]
    points_world = reference.camera.center_world + 2 * reference.camera.rays_world(drawn_stored_px)
    found = np.array(scene.key_frames[0].elements[0].amodal.geoms[0].exterior.coords)[:-1]
    if orientation in MIRRORED:
        expected = reference.camera.project(points_world)[0]
    else:
        expected = frame.camera.project(points_world)[0]
    assert {tuple(p) for p in found.round(6).tolist()} == {tuple(p) for p in expected.round(6).tolist()}
    if orientation not in (1, *MIRRORED):
        assert (frame.camera.width > frame.camera.height) == (orientation not in SIDEWAYS)
        if not with_lens:
            assert np.array_equal(read_rgb(frame), turn.image(stored[1]))
    tagged = [line for line in scene.warnings if "orientation tag" in line]
    assert len(tagged) == (0 if orientation == 1 else 1 if orientation in SIDEWAYS else 2)


@pytest.mark.parametrize("orientation", SIDEWAYS)
def test_the_size_of_a_drawing_says_whether_it_was_shown_turned(tiny: Path, edit_json: Edit, orientation: int) -> None:
    tag_all(tiny, orientation)  # and annotations at the stored size, 64x48
    scene = load_scene(tiny)
    assert not any("annotations.json" in line for line in scene.warnings)
    assert scene.key_frames[0].elements[0].amodal.area == pytest.approx(64 * 48)
    edit_json(tiny / "annotations.json", lambda d: d.update(image_size=[96, 128]))
    scene = load_scene(tiny)
    assert any("96x128 px instead of 48x64" in line for line in scene.warnings)
    edit_json(tiny / "annotations.json", lambda d: d.update(image_size=None))
    assert any("annotations.json: 2 annotated images have an orientation tag" in w for w in load_scene(tiny).warnings)


@pytest.mark.parametrize("orientation", SIDEWAYS)
def test_cameras_of_the_size_shown_are_of_the_image_shown(tiny: Path, edit_json: Edit, orientation: int) -> None:
    tag_all(tiny, orientation)
    edit_json(tiny / "transforms.json", lambda d: d.update(w=48, h=64, cx=24, cy=32))
    edit_json(tiny / "annotations.json", lambda d: d.update(image_size=[48, 64]))
    scene = load_scene(tiny)
    assert any("cameras are of the images as shown, by their size" in line for line in scene.warnings)
    assert np.array_equal(read_rgb(scene.frames[0]), shown_rgb(tiny / "images/000.png"))
    assert (scene.frames[0].camera.width, scene.frames[0].camera.height) == (48, 64)
    np.testing.assert_allclose(scene.frames[1].camera.center_world, [0.1, 0, 0], atol=1e-12)


@pytest.mark.parametrize("of_shown", [False, True])
@pytest.mark.parametrize("orientation", ALL[1:])
def test_cameras_of_another_size_are_scaled_to_the_image_they_are_of(
    tiny: Path, edit_json: Edit, orientation: int, of_shown: bool
) -> None:
    tag_all(tiny, orientation)
    width, height = shown_size(orientation) if of_shown else (64, 48)
    seen = {"w": width, "h": height, "fl_x": 60.0, "fl_y": 61.0, "cx": width / 2 + 1, "cy": height / 2 - 2}
    edit_json(tiny / "transforms.json", lambda d: d.update(seen))
    edit_json(tiny / "annotations.json", lambda d: d.update(image_size=shown_size(orientation)))
    before = load_scene(tiny)
    edit_json(tiny / "transforms.json", lambda d: d.update({key: 3 * value for key, value in seen.items()}))
    after = load_scene(tiny)
    says = f"images of {3 * width}x{3 * height} px, but the images are {width}x{height}: their intrinsics were scaled"
    assert [line for line in after.warnings if line not in before.warnings and says not in line] == []
    assert sum(says in line for line in after.warnings) == 1
    _assert_same_scene(before, after)
    # Another shape than either is of neither.
    edit_json(tiny / "transforms.json", lambda d: d["frames"][2].update(w=150, h=150, cx=75, cy=75))
    (line,) = [line for line in load_scene(tiny).warnings if "have an orientation tag (EXIF): " in line]
    assert line.startswith("4 images")
    edit_json(tiny / "transforms.json", lambda d: d.update(w=150, h=150, cx=75, cy=75))
    with pytest.raises(GtlayoutError, match="is for images of 150x150 px"):
        load_scene(tiny)


@pytest.mark.parametrize("stored", [(200, 201), (201, 200)])
def test_nearly_square_images_are_told_apart_by_their_longer_side(
    tiny: Path, edit_json: Edit, stored: tuple[int, int]
) -> None:
    for path in sorted((tiny / "images").iterdir()):
        Image.open(path).resize(stored).save(path)
    tag_all(tiny, 6)
    edit_json(tiny / "annotations.json", lambda d: d.update(image_size=None))
    for width, height, says in (
        (*stored, "stored"),
        (*stored[::-1], "shown"),
        (2 * stored[0], 2 * stored[1], "stored"),
        (2 * stored[1], 2 * stored[0], "shown"),
        (400, 400, "stored"),
    ):
        edit_json(tiny / "transforms.json", lambda d, w=width, h=height: d.update(w=w, h=h, cx=w / 2, cy=h / 2))  # type: ignore[misc]
        (line,) = [line for line in load_scene(tiny).warnings if "have an orientation tag (EXIF): " in line]
        assert ("as shown, by their size" if says == "shown" else "pixels as stored") in line


def test_one_camera_of_images_with_a_tag_and_without(tiny: Path, edit_json: Edit) -> None:
    """A phone's images, and among them one that a program has turned upright."""
    shown = shown_rgb(tiny / "images/002.png")
    tag_all(tiny, 6)
    Image.fromarray(TURNS[5].image(shown)).save(tiny / "images/002.png")
    edit_json(tiny / "transforms.json", lambda d: d.update(w=96, h=128, cx=48, cy=64))
    edit_json(tiny / "annotations.json", lambda d: d.update(image_size=None))
    scene = load_scene(tiny)
    assert [(frame.camera.width, frame.camera.height) for frame in scene.frames] == [(48, 64)] * 5
    assert np.array_equal(read_rgb(scene.frames[2]), TURNS[5].image(shown))
    assert read_rgb(scene.frames[0]).shape == (64, 48, 3)


def test_depth_maps_turn_with_their_image(tiny: Path) -> None:
    ramp = np.arange(1000, 1000 + 64 * 48, dtype=np.uint16).reshape(48, 64)
    (tiny / "depth").mkdir()
    (tiny / "depth/000.png").write_bytes(cv2.imencode(".png", ramp)[1].tobytes())
    tag_all(tiny, 6)
    frame = load_scene(tiny).frames[0]
    np.testing.assert_allclose(read_depth(frame), TURNS[5].image(ramp) / 1000, rtol=1e-6)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("orientation", ALL)
def test_import_writes_upright_images_without_the_tag(
    tiny: Path, edit_json: Edit, orientation: int, suffix: str, capfd: pytest.CaptureFixture[str]
) -> None:
    for path in sorted((tiny / "images").iterdir()):
        Image.open(path).save(path.with_suffix(suffix))
        if suffix != ".png":
            path.unlink()
    edit_json(
        tiny / "transforms.json", lambda d: [f.update(file_path=f["file_path"][:-4] + suffix) for f in d["frames"]]
    )
    tag_all(tiny, orientation)
    edit_json(tiny / "annotations.json", lambda d: d.update(image_size=shown_size(orientation)))
    assert main(["import", str(tiny), str(tiny / "out")]) == 0
    assert ("orientation tag" in capfd.readouterr().out) == (orientation > 1)
    before, after = load_scene(tiny), load_scene(tiny / "out")
    assert not any("orientation" in line for line in after.warnings)
    for path in sorted((tiny / "out/images").iterdir()):
        with Image.open(path) as image:
            assert image.getexif().get(0x112, 1) == 1
            mirrored = orientation in MIRRORED
            assert image.size == ((64, 48) if mirrored else tuple(shown_size(orientation)))
    _assert_same_scene(before, after)


def _assert_same_scene(before: Scene, after: Scene) -> None:
    for one, other in zip(before.frames, after.frames, strict=True):
        np.testing.assert_allclose(one.camera.K, other.camera.K, atol=1e-9)
        np.testing.assert_allclose(one.camera.R_cam_from_world, other.camera.R_cam_from_world, atol=1e-9)
        assert np.abs(read_rgb(one).astype(int) - read_rgb(other)).mean() < 20  # coded twice
    for key, again in zip(before.key_frames, after.key_frames, strict=True):
        assert key.elements[0].amodal.equals(again.elements[0].amodal)


def test_check_names_images_with_an_orientation(tiny: Path, capfd: pytest.CaptureFixture[str]) -> None:
    tag_all(tiny, 3)
    main(["check", str(tiny)])
    said = " ".join(capfd.readouterr().out.split())
    assert "5 images have an orientation tag (EXIF): turned by 180° when shown" in said
    assert "annotations.json: 2 annotated images have an orientation tag (EXIF), first 001.png" in said


def test_images_that_are_not_what_they_are_called_are_coded_anew(tiny: Path, edit_json: Edit) -> None:
    """Browsers and phones save WebP and HEIC as .jpg."""
    for path in sorted((tiny / "images").iterdir()):
        with Image.open(path) as image:
            image.save(path.with_suffix(".webp"), lossless=True)
        path.unlink()
        path.with_suffix(".webp").rename(path.with_suffix(".jpg"))
    edit_json(
        tiny / "transforms.json", lambda d: [f.update(file_path=f["file_path"][:-4] + ".jpg") for f in d["frames"]]
    )
    assert main(["import", str(tiny), str(tiny / "out")]) == 0
    for path in (tiny / "out/images").iterdir():
        with Image.open(path) as image:
            assert image.format == "JPEG"


@pytest.mark.parametrize("content", [b"no image", b""])
def test_a_damaged_image_costs_itself(tiny: Path, content: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    (tiny / "images/002.png").write_bytes(content)
    assert main(["import", str(tiny), str(tiny / "out")]) == 0
    assert "002.png: damaged, or not an image: left out" in capfd.readouterr().out
    assert len(load_scene(tiny / "out").frames) == 4
