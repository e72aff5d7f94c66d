"""COLMAP models as pycolmap itself makes them: every lens, rigs and frames, text and binary, whole and cut off."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from scene_checks import assert_one_camera_skipped

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.colmap.reader import read_colmap
from gtlayout.io.cameras.undistort import undistortion
from gtlayout.io.lens import PARAMETERS, Lens
from gtlayout.io.scene_folder import load_scene

WIDTH, HEIGHT = 64, 48
SMALL: dict[str, float] = {
    **{"f": 60.0, "fx": 60.0, "fy": 62.0, "cx": 31.5, "cy": 24.75, "omega": 0.3, "alpha": 0.4, "beta": 1.1},
    **{"k": 0.02, "k0": 0.02, "k1": 0.02, "k2": -0.01, "k3": 0.004, "k4": -0.002, "k5": 0.001, "k6": 0.002},
    **{"p0": 0.001, "p1": 0.001, "p2": -0.002, "s0": 0.001, "s1": -0.001, "s2": 0.001, "s3": -0.001},
    **{"sx1": 0.001, "sy1": -0.001},
}
"""A value for each parameter of each model: distortions of up to a pixel, or a fisheye's of several."""
PANORAMAS = {"EQUIRECTANGULAR"}
MODELS = sorted(set(pycolmap.CameraModelId.__members__) - {"INVALID"})
LENSES = [model for model in MODELS if model not in PANORAMAS]
Write = Callable[[pycolmap.Reconstruction, Path], None]


def _write_text(model: pycolmap.Reconstruction, folder: Path) -> None:
    model.write_text(str(folder))


def _write_binary(model: pycolmap.Reconstruction, folder: Path) -> None:
    model.write_binary(str(folder))


@pytest.mark.parametrize("model", LENSES)
def test_every_lens_loads_and_undistorts(tiny: Path, model: str) -> None:
    """A world point goes through COLMAP's lens and our undistortion to where the scene's pinhole camera sees it."""
    camera = _camera(model)
    _scene(tiny, camera)
    frame = load_scene(tiny).frames[1]
    rng = np.random.default_rng(0)
    depth = rng.uniform(1, 4, 50)
    points = np.column_stack([rng.uniform(-0.4, 0.4, 50) * depth, rng.uniform(-0.3, 0.3, 50) * depth, depth])
    points_cam = points @ frame.camera.R_cam_from_world.T + frame.camera.t_cam_from_world
    np.testing.assert_allclose(points_cam, points + np.array([0.1, 0, 0]))
    seen_px = np.asarray(camera.img_from_cam(points_cam))
    lens = undistortion(Lens(model, WIDTH, HEIGHT, tuple(camera.params)))
    assert (frame.undistort is None) == (lens is None) == ("PINHOLE" in model)
    straight_px = lens.points(seen_px) if lens else seen_px
    np.testing.assert_allclose(straight_px, frame.camera.project(points)[0], atol=1e-6)


@pytest.mark.parametrize(("number", "model"), list(enumerate(PARAMETERS)))
def test_lenses_are_those_of_pycolmap(number: int, model: str) -> None:
    """Names and numbers of models, parameters, what is a pinhole, other sizes and rays."""
    camera = (
        _camera(model) if model not in PANORAMAS else pycolmap.Camera(model=model, width=64, height=48, params=[64, 48])
    )
    assert sorted(PARAMETERS) == MODELS
    assert pycolmap.CameraModelId.__members__[model] == pycolmap.CameraModelId(number)
    assert ", ".join(PARAMETERS[model]).replace("w, h", "w,h") == camera.params_info
    lens = Lens(model, WIDTH, HEIGHT, tuple(camera.params))
    assert np.array_equal(lens.focal_px, camera.params[camera.focal_length_idxs()])
    assert np.array_equal(lens.principal_px, camera.params[camera.principal_point_idxs()])
    points_px = np.array([[3.0, 4.0], [40.0, 30.0]])
    np.testing.assert_allclose(lens.rays(points_px), np.asarray(camera.cam_from_img(points_px)), rtol=1e-14)
    if model not in PANORAMAS:
        assert np.array_equal(lens.K, camera.calibration_matrix())
    camera.rescale(160, 118)
    assert lens.rescaled(160, 118) == Lens(model, 160, 118, tuple(camera.params))


@pytest.mark.parametrize(("coefficient", "is_pinhole"), [(0.0, True), (1e-8, True), (-1.1e-8, False)])
def test_a_pinhole_by_its_coefficients(coefficient: float, is_pinhole: bool) -> None:
    params = [60.0, 62.0, 32.0, 24.0, 0.0, 0.0, 0.0, coefficient]
    assert pycolmap.Camera(model="OPENCV", width=WIDTH, height=HEIGHT, params=params).is_undistorted() == is_pinhole
    assert Lens("OPENCV", WIDTH, HEIGHT, tuple(params)).is_pinhole == is_pinhole
    assert not Lens("OPENCV_FISHEYE", WIDTH, HEIGHT, tuple(params)).is_pinhole


@pytest.mark.parametrize("model", sorted(PANORAMAS))
def test_a_panorama_is_a_clear_error(tiny: Path, model: str) -> None:
    _scene(tiny, pycolmap.Camera(camera_id=1, model=model, width=WIDTH, height=HEIGHT, params=[WIDTH, HEIGHT]))
    with pytest.raises(GtlayoutError, match=f"{model}.*"):
        load_scene(tiny)


@pytest.mark.parametrize("write", [_write_text, _write_binary])
def test_rigs_of_several_cameras(tmp_path: Path, write: Write) -> None:
    made = _synthesized()
    for number, camera in made.cameras.items():
        camera.params = [1200.0 + number, *camera.params[1:]]
    write(made, tmp_path)
    read = {image.name: image for image in read_colmap(tmp_path, tmp_path).images}
    assert len(read) == 12
    assert len({image.camera for image in read.values()}) == 4
    for image in made.images.values():
        found, expected = read[image.name], image.cam_from_world().matrix()
        np.testing.assert_allclose(found.R_cam_from_world, expected[:, :3], atol=1e-12)
        np.testing.assert_allclose(found.t_cam_from_world, expected[:, 3], atol=1e-12)
        assert found.camera.model == image.camera.model_name
        np.testing.assert_allclose(found.camera.params, image.camera.params, rtol=1e-12)


@pytest.mark.parametrize("write", [_write_text, _write_binary])
def test_sub_folders_and_images_without_pose(tiny: Path, write: Write) -> None:
    """COLMAP drops an image without pose when it writes; the others have no points, so their second line is empty."""
    (tiny / "transforms.json").unlink()
    (tiny / "images/left").mkdir()
    for i in range(5):
        (tiny / f"images/{i:03d}.png").rename(tiny / f"images/left/{i:03d}.png")
    text = (tiny / "annotations.json").read_text()
    (tiny / "annotations.json").write_text(text.replace('"image": "', '"image": "left/'))
    model = _reconstruction(_camera("PINHOLE"), [f"left/{i:03d}.png" for i in range(5)])
    model.add_image_with_trivial_frame(pycolmap.Image(name="left/005.png", camera_id=1, image_id=6))
    (tiny / "sparse/0").mkdir(parents=True)
    write(model, tiny / "sparse/0")
    scene = load_scene(tiny)
    assert [frame.name for frame in scene.frames] == [f"left/{i:03d}.png" for i in range(5)]
    assert [frame.image_path for frame in scene.frames] == [tiny / f"images/left/{i:03d}.png" for i in range(5)]
    np.testing.assert_allclose([f.camera.t_cam_from_world[0] for f in scene.frames], [0, 0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize("part", ["cameras", "images", "points3D", "rigs", "frames"])
def test_cut_off_binary(tmp_path: Path, part: str) -> None:
    """pycolmap alone would read on past the end of the file, for hours."""
    whole = tmp_path / "whole"
    whole.mkdir()
    _write_binary(_synthesized(), whole)
    content = (whole / f"{part}.bin").read_bytes()
    for share in (0.0, 0.1, 0.5, 0.9, 1.0):
        model = tmp_path / str(share)
        shutil.copytree(whole, model)
        (model / f"{part}.bin").write_bytes(content[: int(share * (len(content) - 1))])
        with pytest.raises(GtlayoutError, match=rf"{share}/{part}\.bin is cut off or damaged"):
            read_colmap(tmp_path, model)


def test_a_scaled_quaternion_is_no_rotation(tmp_path: Path) -> None:
    _write_binary(_synthesized(), tmp_path)
    content = bytearray((tmp_path / "frames.bin").read_bytes())
    content[16:48] = (np.frombuffer(content[16:48], dtype="<f8") * 1.5).tobytes()
    (tmp_path / "frames.bin").write_bytes(content)
    found = read_colmap(tmp_path, tmp_path)
    assert len(found.images) == 11, "pycolmap makes that of the rig's other camera unit length"
    assert_one_camera_skipped(found.warnings, r"1 of 12 .*the pose of camera.* is no rotation")


@pytest.mark.parametrize("sides", [(2**40, 48), (64, 70_000), (1, 48)])
def test_absurd_image_sizes(tmp_path: Path, sides: tuple[int, int]) -> None:
    camera = pycolmap.Camera(camera_id=1, model="PINHOLE", width=sides[0], height=sides[1], params=[60, 60, 32, 24])
    _write_text(_reconstruction(camera, ["a.png"]), tmp_path)
    with pytest.raises(GtlayoutError, match="camera 1 has no valid size"):
        read_colmap(tmp_path, tmp_path)


def _camera(model: str) -> pycolmap.Camera:
    camera = pycolmap.Camera.create_from_model_name(1, model, 60.0, WIDTH, HEIGHT)
    camera.params = [SMALL[name.strip()] for name in camera.params_info.split(",")]
    return camera


def _reconstruction(camera: pycolmap.Camera, names: list[str]) -> pycolmap.Reconstruction:
    """Cameras along -x, without points."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    for i, name in enumerate(names):
        cam_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(np.eye(3)), np.array([0.1 * i, 0, 0]))
        image = pycolmap.Image(name=name, camera_id=camera.camera_id, image_id=i + 1)
        model.add_image_with_trivial_frame(image, cam_from_world)
    return model


def _scene(root: Path, camera: pycolmap.Camera) -> None:
    """The tiny scene with that camera instead of its own."""
    (root / "transforms.json").unlink()
    (root / "sparse/0").mkdir(parents=True)
    _write_binary(_reconstruction(camera, [f"{i:03d}.png" for i in range(5)]), root / "sparse/0")


def _synthesized() -> pycolmap.Reconstruction:
    """Two rigs of two cameras with three frames each, and points."""
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=2, num_cameras_per_rig=2, num_frames_per_rig=3, num_points3D=20, num_points2D_without_point3D=2
    )
    return pycolmap.synthesize_dataset(options)
