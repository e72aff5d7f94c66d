"""Every lens key of transforms.json: of nerfstudio, instant-ngp and Blender, for the file and for a frame."""

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
from gtlayout.io.cameras.transforms_lens import FISHEYE, KNOWN, PERSPECTIVE, read_lens, warnings_of
from gtlayout.io.lens import Lens
from gtlayout.io.scene_folder import load_scene

Edit = Callable[[Path, Callable[[Any], object]], None]
SIZE = {"w": 320, "h": 240}
PINHOLE = {"fl_x": 250.0, "fl_y": 240.0, "cx": 161.0, "cy": 119.0, **SIZE}
RADIAL = {"k1": 0.02, "k2": -0.003, "k3": 0.001, "k4": -0.0004}


def lens(file: dict[str, Any], frame: dict[str, Any] | None = None) -> Lens:
    return read_lens(file, frame or {}, None, "a.json: frame 1")


@pytest.mark.parametrize("k4", [0.0, -0.0004])
@pytest.mark.parametrize(
    "said", [{"is_fisheye": True}, {"is_fisheye": 1}, *({"camera_model": name} for name in FISHEYE)], ids=str
)
def test_a_fisheye_is_opencvs(said: dict[str, Any], k4: float) -> None:
    """The same pixels as OpenCV's fisheye model gives, with its fourth coefficient and without."""
    camera = lens({**PINHOLE, **RADIAL, "k4": k4, "p1": 0, "p2": 0.0, **said})
    points = np.array([[0.3, -0.2, 1.0], [1.1, 0.9, 1.0], [-2.0, 0.4, 1.0]])
    K = np.array([[250.0, 0, 161], [0, 240, 119], [0, 0, 1]])
    expected, _ = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), K, np.array([0.02, -0.003, 0.001, k4])
    )
    np.testing.assert_allclose(camera.colmap.img_from_cam(points), expected[:, 0], atol=1e-9)


def test_a_fisheye_of_one_frame_and_a_perspective_one_in_a_file_of_fisheyes() -> None:
    assert lens(PINHOLE, {"is_fisheye": True}).model == "OPENCV_FISHEYE"
    assert lens({**PINHOLE, "is_fisheye": True}, {"is_fisheye": False}).model == "OPENCV"
    assert lens({**PINHOLE, "camera_model": "OPENCV_FISHEYE"}, {"is_fisheye": False}).model == "OPENCV"
    assert lens({**PINHOLE, "is_fisheye": False}, {"camera_model": "OPENCV_FISHEYE"}).model == "OPENCV_FISHEYE"


def test_tangential_coefficients_of_a_fisheye() -> None:
    """They shift what the angles give, as COLMAP's thin prism model does."""
    camera = lens({**PINHOLE, **RADIAL, "is_fisheye": True, "p1": 0.01, "p2": -0.02})
    assert camera.model == "THIN_PRISM_FISHEYE"
    assert list(camera.params) == [250, 240, 161, 119, 0.02, -0.003, 0.01, -0.02, 0.001, -0.0004, 0, 0]


@pytest.mark.parametrize("name", [*PERSPECTIVE, "opencv", None])
def test_perspective_lenses_have_the_coefficients_that_are_given(name: str | None) -> None:
    keys = {**PINHOLE, "k1": 0.1, "k2": 0.2, "p1": 0.3, "p2": 0.4, **({"camera_model": name} if name else {})}
    assert list(lens(keys).params) == [250, 240, 161, 119, 0.1, 0.2, 0.3, 0.4]
    assert list(lens({**keys, "k3": 0.5}).params)[4:] == [0.1, 0.2, 0.3, 0.4, 0.5, 0, 0, 0]


def test_colmaps_lenses_by_the_names_of_their_parameters() -> None:
    full = {f"k{i}": i / 100 for i in range(1, 7)} | {"p1": 0.07, "p2": 0.08}
    camera = lens({**PINHOLE, **full, "camera_model": "FULL_OPENCV"})
    assert list(camera.params)[4:] == [0.01, 0.02, 0.07, 0.08, 0.03, 0.04, 0.05, 0.06]
    assert list(lens({**PINHOLE, "omega": 0.9, "camera_model": "FOV"}).params)[4:] == [0.9]
    prism = lens({**PINHOLE, **RADIAL, "sx1": 0.1, "sy1": 0.2, "camera_model": "THIN_PRISM_FISHEYE"})
    assert list(prism.params)[4:] == [0.02, -0.003, 0, 0, 0.001, -0.0004, 0.1, 0.2]


@pytest.mark.parametrize(
    "K",
    [
        [[250, 0, 161], [0, 240, 119], [0, 0, 1]],
        [250, 0, 161, 0, 240, 119, 0, 0, 1],
        [[250, 0, 161, 0], [0, 240, 119, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    ],
)
def test_K_of_the_file_and_of_a_frame(K: list[Any]) -> None:
    assert list(lens({"K": K, **SIZE}).params)[:4] == [250, 240, 161, 119]
    assert list(lens({**SIZE, "fl_x": 90, "cx": 5, "cy": 6}, {"K": K}).params)[:4] == [250, 240, 161, 119]
    assert list(lens({"K": K, **SIZE}, {"fl_x": 90}).params)[:4] == [90, 240, 161, 119]
    assert list(lens({"K": K, **PINHOLE}).params)[:4] == [250, 240, 161, 119], "both, and they agree"


def test_angles_of_view() -> None:
    """Radians in camera_angle, degrees in fov; y like x, and the centre, when nothing else is said."""
    angle = 2 * math.atan(160 / 250)
    assert list(lens({"camera_angle_x": angle, **SIZE}).params)[:4] == pytest.approx([250, 250, 160, 120])
    assert lens({"x_fov": math.degrees(angle), **SIZE}).params[0] == pytest.approx(250)
    both = {"camera_angle_x": angle, "camera_angle_y": 2 * math.atan(120 / 200), **SIZE}
    assert list(lens(both).params[:2]) == pytest.approx([250, 200])
    assert list(lens({"y_fov": math.degrees(2 * math.atan(120 / 200)), **SIZE}).params[:2]) == pytest.approx([200] * 2)
    assert list(lens(PINHOLE, {"camera_angle_x": 2 * math.atan(160 / 90)}).params[:2]) == pytest.approx([90, 240])
    assert lens({**PINHOLE, "camera_angle_x": angle / 2}).params[0] == 250, "the focal length goes first"
    assert list(lens({"fl_x": 250, **SIZE}).params)[:4] == [250, 250, 160, 120]


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"is_fisheye": "yes"}, "is_fisheye must be true or false, not 'yes'"),
        ({"is_fisheye": True, "camera_model": "OPENCV"}, "camera_model OPENCV and is_fisheye True contradict"),
        ({"is_fisheye": False, "camera_model": "OPENCV_FISHEYE"}, "OPENCV_FISHEYE and is_fisheye False contradict"),
        ({"camera_model": ["OPENCV"]}, "camera_model .'OPENCV'. is not supported; known are PERSPECTIVE, OPENCV,"),
        *(
            ({"camera_model": name}, f"camera_model '{name}' is not supported")
            for name in ("EQUIRECTANGULAR", "OMNIDIRECTIONALSTEREO_L", "VR180_L", "ORTHOPHOTO", "FISHEYE624")
        ),
        ({"equirectangular": True}, "a lens with equirectangular is not supported"),
        ({"latlong": True}, "a lens with latlong is not supported"),
        ({"ftheta_p0": 0.0}, "a lens with ftheta_p0 is not supported"),
        ({"k4": 0.1}, "k4 is supported for OPENCV_FISHEYE and FULL_OPENCV only"),
        ({"k5": 0.1}, "a lens OPENCV has no k5, which is 0.1"),
        ({"omega": 0.1, "is_fisheye": True}, "a lens OPENCV_FISHEYE has no omega, which is 0.1"),
        ({"sk_x": 0.3}, "pixels with skew .sk_x = 0.3. are not supported"),
        ({"K": [[250, 1, 161], [0, 240, 119], [0, 0, 1]]}, "pixels have no skew"),
        ({"K": [[250, 0], [0, 240]]}, "K must be 3x3 finite numbers"),
        ({"K": [["a"] * 3] * 3}, "K must be 3x3 finite numbers"),
        ({"K": [[500, 0, 322], [0, 480, 238], [0, 0, 1]]}, "fl_x is 250, but K says 500"),
        ({"cx": math.inf}, "cx must be a finite number, not inf"),
        ({"cx": 321.0}, r"the principal point .321, 119. lies outside of images of 320x240 px"),
        ({"cx": -5000}, r"the principal point .-5000, 119. lies outside of images of 320x240 px"),
    ],
)
def test_what_cannot_be_read_is_refused_by_name(keys: dict[str, Any], says: str) -> None:
    for file, frame in (({**PINHOLE, **keys}, {}), (dict(PINHOLE), {**PINHOLE, **keys})):
        with pytest.raises(GtlayoutError, match=f"^a.json: frame 1: .*{says}"):
            lens(file, frame)


def test_a_bad_lens_costs_only_its_frame(tiny: Path, edit_json: Edit) -> None:
    edit_json(tiny / "transforms.json", lambda d: d["frames"][2].update(cx=640.0))
    scene = load_scene(tiny)
    assert [frame.name for frame in scene.frames] == ["000.png", "001.png", "003.png", "004.png"]
    assert_one_camera_skipped(scene.warnings, r"1 of 5 .*002\.png: the principal point \(640, 24\) lies outside")


@pytest.mark.parametrize(
    ("says", "stated"), [(True, {"w": 64, "h": 48}), (False, {})], ids=["size stated", "size of the images"]
)
def test_intrinsics_of_larger_images(tiny: Path, edit_json: Edit, says: bool, stated: dict[str, int]) -> None:
    """Twice as large. Where the file says that it is for these images, its word counts, and there is a doubt."""

    def enlarge(data: dict[str, Any]) -> None:
        del data["w"], data["h"]
        data.update(cx=52, cy=39, **stated)

    edit_json(tiny / "transforms.json", enlarge)
    if says:
        (warning,) = [line for line in load_scene(tiny).warnings if "principal point" in line]
        assert "5 of 5 cameras may not be those of their images" in warning
        assert "seem to be for images of about 104x78 px" in warning
    else:
        with pytest.raises(GtlayoutError, match="seem to be for images of about 104x78 px"):
            load_scene(tiny)


def test_lens_keys_that_are_not_read_are_said_once(tiny: Path, edit_json: Edit) -> None:
    def add(data: dict[str, Any]) -> None:
        data.update(rolling_shutter=[0, 0, 0.1, 0], aabb_scale=16, k5=0, fisheye_crop_radius=90, ply_file_path="a.ply")
        data["frames"][1].update(xi=0.4, rolling_shutter=[0, 1, 0], mask_path="a.png", sharpness=3.0, time=0.5)

    edit_json(tiny / "transforms.json", add)
    warnings = read_transforms(tiny, tiny / "transforms.json").warnings
    path = tiny / "transforms.json"
    assert warnings == (
        f"{path}: these keys look like a lens and are not read: rolling_shutter, fisheye_crop_radius, xi",
    )


def test_keys_of_writers_are_no_unread_lenses() -> None:
    """Of files that nerfstudio, instant-ngp's scripts, neuralangelo and Record3D write."""
    file = {
        **PINHOLE,
        **{"k1": 0, "k2": 0, "k3": 0, "k4": 0, "p1": 0, "p2": 0, "is_fisheye": False, "sk_x": 0.0, "sk_y": 0.0},
        **{"camera_model": "OPENCV", "orientation_override": "none", "applied_transform": [[1, 0, 0, 0]]},
        **{"applied_scale": 1.0, "ply_file_path": "sparse_pc.ply", "aabb_scale": 16, "aabb_range": [[-1, 1]]},
        **{"sphere_center": [0, 0, 1], "sphere_radius": 2.0, "n_frames": 9, "integer_depth_scale": 0.001},
        **{"train_filenames": ["a"], "scale": 0.33, "offset": [0.5] * 3, "up": [0, 0, 1], "from_na": True},
        **{"enable_depth_loading": True, "sharpen": 1, "render_aabb": [[0] * 3] * 2, "camera_label": "left"},
    }
    frame = {"file_path": "a", "transform_matrix": [], "colmap_im_id": 3, "depth_file_path": "d", "mask_path": "m",
             "sharpness": 1.0, "timestamp": 1.0, "camera_id": 1, "driver_parameters": {"LightX": 1}}  # fmt: skip
    assert warnings_of([file, frame], "a.json") == ()


def test_fisheye_without_coefficients_is_doubted() -> None:
    """instant-ngp takes it for no distortion, nerfstudio for a fisheye."""
    assert "delete is_fisheye" in warnings_of([{**PINHOLE, "is_fisheye": True, "k1": 0}], "a.json")[0]
    assert warnings_of([{**PINHOLE, "is_fisheye": True}, {"k1": 0.1}], "a.json") == ()
    assert warnings_of([PINHOLE], "a.json") == ()


def test_all_known_models_can_be_read() -> None:
    for name in KNOWN:
        assert lens({**PINHOLE, "camera_model": name, **({"omega": 0.5} if name == "FOV" else {})})
