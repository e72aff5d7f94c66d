"""Intrinsics for images of another size, doubled cameras, and what one bad camera costs, whatever the format."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_formats import FORMATS, cameras_in_general_position
from scene_checks import assert_one_camera_skipped

from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.frames import build_frames
from gtlayout.io.cameras.lenses import check_lens, doubt, lens, scaled
from gtlayout.io.lens import Lens
from gtlayout.io.pixels.images import read_gray
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.sources import PosedImage
from gtlayout.scene import Camera

STATED = ("colmap_text", "colmap_binary", "nerfstudio", "arkitscenes", "polycam")
"""Formats that say for what size their intrinsics are."""
NOT_STATED = ("scannet", "seven_scenes")


def resized(cameras: Sequence[Camera], x: float, y: float) -> list[Camera]:
    """For images so many times as wide and high."""
    zoom = np.diag([x, y, 1.0])
    return [replace(one, K=zoom @ one.K, width=round(x * one.width), height=round(y * one.height)) for one in cameras]


@pytest.mark.parametrize("name", STATED)
def test_intrinsics_are_scaled_to_the_images(name: str, tmp_path: Path) -> None:
    cameras = cameras_in_general_position()
    FORMATS[name](tmp_path, resized(cameras, 3, 3))
    scene = load_scene(tmp_path)
    for frame in scene.frames:
        np.testing.assert_allclose(frame.camera.K, cameras[0].K, atol=1e-9)
        assert read_gray(frame).shape == (48, 64)
    (warning,) = [line for line in scene.warnings if "scaled" in line]
    assert "5 of 5 cameras are for images of 192x144 px, but the images are 64x48: their intrinsics were sc" in warning
    assert str(scene.frames[0].image_path) in warning


@pytest.mark.parametrize("name", NOT_STATED)
def test_intrinsics_without_a_size_are_refused_by_their_principal_point(name: str, tmp_path: Path) -> None:
    FORMATS[name](tmp_path, resized(cameras_in_general_position(), 2, 2))
    with pytest.raises(
        GtlayoutError, match=r"principal point \(6[01].*seem to be for images of about 12[0-9]x10[0-9] px"
    ):
        load_scene(tmp_path)


@pytest.mark.parametrize("name", [*STATED, *NOT_STATED])
def test_check_names_a_doubted_size(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A fifth larger, which is no proof: whether the format states a size or not, it is read, and said."""
    off = [replace(one, width=64, height=48) for one in resized(cameras_in_general_position(), 1.25, 1.25)]
    FORMATS[name](tmp_path, off)
    main(["check", str(tmp_path)])
    assert "5 of 5 cameras may not be those of their images" in capsys.readouterr().out


def test_images_of_another_shape_cost_their_cameras(tiny: Path, edit_json: Callable[..., None]) -> None:
    edit_json(tiny / "transforms.json", lambda d: d["frames"][2].update(w=48, cx=24))
    scene = load_scene(tiny)
    assert len(scene.frames) == 4
    assert_one_camera_skipped(scene.warnings, r"002\.png: its camera is for images of 48x48 px, but this one is 64x48")


def test_one_odd_image_does_not_say_the_size_of_all(tiny: Path) -> None:
    """Neither the first, nor the last: the others fit their cameras. It fails when it is used."""
    for odd in ("000.png", "004.png"):
        whole = (tiny / "images" / odd).read_bytes()
        (tiny / "images" / odd).write_bytes(cv2.imencode(".png", np.zeros((96, 128), np.uint8))[1].tobytes())
        scene = load_scene(tiny)
        assert all((frame.camera.width, frame.camera.height) == (64, 48) for frame in scene.frames)
        with pytest.raises(GtlayoutError, match=rf"{odd}: 128x96 px, its camera says 64x48"):
            read_gray(next(frame for frame in scene.frames if frame.name == odd))
        (tiny / "images" / odd).write_bytes(whole)


def test_depth_intrinsics_of_another_size_leave_depth_out(tmp_path: Path) -> None:
    FORMATS["scannet"](tmp_path, cameras_in_general_position())
    (tmp_path / "depth").mkdir()
    (tmp_path / "depth/1.png").write_bytes(cv2.imencode(".png", np.full((24, 32), 1000, np.uint16))[1].tobytes())
    K = np.loadtxt(tmp_path / "intrinsic/intrinsic_color.txt")
    np.savetxt(tmp_path / "intrinsic/intrinsic_depth.txt", K)
    scene = load_scene(tmp_path)
    assert all(frame.depth_path is None for frame in scene.frames)
    (warning,) = [line for line in scene.warnings if "depth left out; " in line]
    assert "the depth map's intrinsics: the principal point" in warning
    np.savetxt(tmp_path / "intrinsic/intrinsic_depth.txt", np.diag([0.5, 0.5, 1, 1]) @ K)
    assert load_scene(tmp_path).frames[1].depth_path is not None


@pytest.mark.parametrize(
    ("model", "params"),
    [
        ("SIMPLE_RADIAL", [60, 32, 24, 0.1]),
        ("OPENCV", [60, 61, 32, 24, 0.1, 0.2, 0.01, 0.02]),
        ("OPENCV_FISHEYE", [60, 61, 32, 24, 0.1, 0.02, 0.01, 0.02]),
    ],
)
def test_a_scaled_lens_sees_the_same(model: str, params: list[float]) -> None:
    before = lens(model, (64, 48), params, "a lens")
    after = scaled(before, (160, 120), "a lens")
    points = np.array([[0.1, 0.2, 1.0], [-0.4, 0.3, 1.0]])
    np.testing.assert_allclose(after.colmap.img_from_cam(points), 2.5 * np.asarray(before.colmap.img_from_cam(points)))
    assert (before.width, after.width, after.height) == (64, 160, 120)
    with pytest.raises(GtlayoutError, match="a lens is for images of 64x48 px, but this one is 160x118, another shape"):
        scaled(before, (160, 118), "a lens")


@pytest.mark.parametrize(
    ("cx", "cy", "doubted", "size"),
    [
        (32, 24, False, None),
        (35.0, 26.2, False, None),  # 9 % both
        (35.4, 26.6, True, "71x53"),
        (36.6, 26.4, True, "73x53"),  # 14 and 10 %
        (29.0, 21.6, True, "58x43"),
        (38.0, 24, False, None),  # a lens that is off by 9 % along one side
        (44.7, 24, False, None),
        (44.9, 24, True, None),
        (32, 14.3, True, None),
    ],
)
def test_doubt_of_a_principal_point(cx: float, cy: float, doubted: bool, size: str | None) -> None:
    found = doubt(lens("PINHOLE", (64, 48), [60, 60, cx, cy], "a lens"))
    assert (found is not None) == doubted
    if found is not None:
        assert ("seem to be for images of" in found) == (size is not None)
        assert size is None or size in found


@pytest.mark.parametrize(("times", "fits"), [(1.45, True), (1.55, False), (0.7, True), (0.63, False)])
def test_refusal_where_no_size_is_stated(times: float, fits: bool) -> None:
    params = [60, 60, 32 * times, 24 * times]
    assert lens("PINHOLE", (64, 48), params, "a lens")
    if fits:
        assert lens("PINHOLE", (64, 48), params, "a lens", size_is_stated=False)
    else:
        with pytest.raises(
            GtlayoutError, match=r"^a lens: the principal point .* far off the centre of images of 64x48"
        ):
            lens("PINHOLE", (64, 48), params, "a lens", size_is_stated=False)


@pytest.mark.parametrize("centre", [(-0.1, 24), (64.1, 24), (32, -1), (32, 49), (np.nan, 24), (np.inf, 24)])
def test_a_principal_point_outside_of_the_image(centre: tuple[float, float]) -> None:
    with pytest.raises(GtlayoutError, match=r"^a lens"):
        lens("PINHOLE", (64, 48), [60, 60, *centre], "a lens")


def test_a_panorama_has_no_principal_point() -> None:
    panorama = Lens("EQUIRECTANGULAR", 64, 32, (64.0, 32.0))
    check_lens(panorama, "a lens")
    assert doubt(panorama) is None


def posed(root: Path, number: int, **changes: object) -> PosedImage:
    path = root / f"images/{number:03d}.png"
    camera = Lens("PINHOLE", 64, 48, (60.0, 60.0, 32.0, 24.0))
    image = PosedImage(path.name, path, camera, np.eye(3), np.array([0.1 * number, 0, 0]))
    return replace(image, **changes)  # type: ignore[arg-type]


def test_the_same_camera_again_is_kept_once(tiny: Path) -> None:
    images = [posed(tiny, i) for i in range(5)]
    frames, _, warnings = build_frames(tiny, [*images, images[2]])
    assert [frame.name for frame in frames] == [f"{i:03d}.png" for i in range(5)]
    assert warnings == [f"{tiny}: 002.png has 2 cameras, all the same: one was kept"]


@pytest.mark.parametrize(
    "change",
    [
        {"t_cam_from_world": np.array([0.3, 0, 0])},
        {"R_cam_from_world": np.diag([1.0, -1, -1])},
        {"camera": Lens("PINHOLE", 64, 48, (61.0, 60.0, 32.0, 24.0))},
    ],
)
def test_two_cameras_that_differ_cost_their_image(tiny: Path, change: dict[str, object]) -> None:
    frames, _, warnings = build_frames(tiny, [*(posed(tiny, i) for i in range(5)), posed(tiny, 2, **change)])
    assert [frame.name for frame in frames] == ["000.png", "001.png", "003.png", "004.png"]
    assert warnings == [f"{tiny}: 2 cameras that differ for one image, 002.png: it was left out"]


def test_a_lens_without_a_pinhole_costs_its_image(tiny: Path) -> None:
    panorama = Lens("EQUIRECTANGULAR", 64, 48, (64.0, 48.0))
    frames, _, warnings = build_frames(tiny, [*(posed(tiny, i) for i in range(4)), posed(tiny, 4, camera=panorama)])
    assert len(frames) == 4
    assert_one_camera_skipped(warnings, "1 of 5 .*004.png: camera model EQUIRECTANGULAR cannot be undistorted")


def test_too_few_frames_say_why(tiny: Path) -> None:
    images = [posed(tiny, i) for i in (0, 1, 2, 2)]
    images[3] = posed(tiny, 2, t_cam_from_world=np.zeros(3))
    with pytest.raises(GtlayoutError, match=r"2 frames .* at least 3 are needed \(4 cameras; .*for one image, 002.png"):
        build_frames(tiny, images)


def test_re10k_lines_cost_themselves(tmp_path: Path) -> None:
    (file,) = FORMATS["re10k"](tmp_path, cameras_in_general_position())
    lines = file.read_text().splitlines()
    lines[2] = lines[2].replace(" 0 0 ", " 0 ", 1)
    first, *others = lines
    file.write_text("﻿" + "\r\n".join([first, "", *reversed(others), others[3]]))
    scene = load_scene(tmp_path)
    assert [frame.name for frame in scene.frames] == ["0.jpg", "200000.jpg", "300000.jpg", "400000.jpg"]
    assert_one_camera_skipped(scene.warnings, "2 of 6 .*line 6 has 18 columns")
    assert json.loads((tmp_path / "annotations.json").read_text())["frames"][0]["image"] == "100000.jpg"
