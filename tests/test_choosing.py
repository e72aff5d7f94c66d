"""Several sources of cameras or annotations in one folder, and --cameras and --annotations."""

from __future__ import annotations

import json
import shutil
import unicodedata
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import gtlayout
from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.io.agreement import contradiction
from gtlayout.io.cameras.colmap.reader import write_colmap
from gtlayout.io.cameras.nerfstudio import write_transforms
from gtlayout.io.scene_folder import load_scene, read_cameras
from gtlayout.scene import Camera, FloatArray, Frame

CHOOSE = r"choose with --cameras PATH, or leave one of them in the scene folder"
Change = Callable[[Camera], Camera]


@pytest.fixture
def frames(tiny: Path) -> list[Frame]:
    """Over the tiny scene's images, with poses in general position; its own cameras are gone."""
    (tiny / "transforms.json").unlink()
    rng = np.random.default_rng(1)
    K = np.array([[61.25, 0, 30.5], [0, 62.75, 25.125], [0, 0, 1]])
    cameras = [Camera(K, _rotation(rng.normal(size=3)), rng.normal(size=3) * 3, 64, 48) for _ in range(5)]
    return [Frame(f"{i:03d}.png", tiny / f"images/{i:03d}.png", camera) for i, camera in enumerate(cameras)]


def _rotation(axis_angle: FloatArray) -> FloatArray:
    return cv2.Rodrigues(axis_angle)[0].astype(np.float64)


def _changed(frames: list[Frame], change: Change) -> list[Frame]:
    return [replace(frame, camera=change(frame.camera)) for frame in frames]


def _in_another_world(camera: Camera) -> Camera:
    """Turned, moved, and with another unit: the same cameras."""
    R = _rotation(np.array([1.0, -0.3, 0.6]))
    return camera.placed(camera.R_cam_from_world @ R.T, 7.5 * R @ camera.center_world + (3, -4, 50))


def test_the_largest_of_several_models(tiny: Path, frames: list[Frame]) -> None:
    """Whether they agree or not: they are parts, or stages, of one reconstruction."""
    write_colmap(tiny / "sparse/0", frames[:3])
    write_colmap(tiny / "sparse/1", frames)
    write_colmap(tiny / "sparse/2", _changed(frames[1:], lambda camera: camera.placed(np.eye(3), np.zeros(3))))
    scene = load_scene(tiny)
    assert len(scene.frames) == 5
    sparse = tiny / "sparse"
    assert scene.warnings == (
        f"cameras in more than one place: {sparse / '1'} (COLMAP) with 5 images was read, not "
        f"{sparse / '0'} (COLMAP) with 3, {sparse / '2'} (COLMAP) with 4; " + CHOOSE,
    )


def test_of_equal_models_the_first(tiny: Path, frames: list[Frame]) -> None:
    write_colmap(tiny / "sparse/1", frames)
    write_colmap(tiny / "sparse/0", frames)
    assert read_cameras(tiny)[0].path == tiny / "sparse/0"


def test_images_that_are_not_there_do_not_count(tiny: Path, frames: list[Frame]) -> None:
    write_colmap(tiny / "sparse/0", [*frames[:3], *(replace(frame, name=f"gone/{frame.name}") for frame in frames)])
    write_colmap(tiny / "sparse/1", frames[:4])
    assert read_cameras(tiny)[0].path == tiny / "sparse/1"


def test_images_that_are_spelled_otherwise_on_disk_count(tiny: Path, frames: list[Frame]) -> None:
    for frame in frames:
        frame.image_path.rename(tiny / "images" / unicodedata.normalize("NFD", f"Küche{frame.name}"))
    write_colmap(tiny / "sparse/0", [replace(frame, name=f"Küche{frame.name}") for frame in frames])
    named = [replace(frame, name=f"Ku\u0308che{frame.name}") for frame in frames[:4]]
    write_transforms(
        tiny / "transforms.json", [replace(frame, image_path=tiny / "images" / frame.name) for frame in named]
    )
    assert read_cameras(tiny)[0].path == tiny / "sparse/0"
    assert len(load_scene(tiny).frames) == 5


def test_a_model_that_cannot_be_read_is_left_out(tiny: Path, frames: list[Frame]) -> None:
    write_colmap(tiny / "sparse/0", frames)
    (tiny / "sparse/0/points3D.txt").unlink()
    write_colmap(tiny / "sparse/1", frames[:3])
    scene = load_scene(tiny)
    assert len(scene.frames) == 3
    assert any("sparse/0 is incomplete" in line and "these cameras were left out" in line for line in scene.warnings)
    (tiny / "sparse/1/points3D.txt").unlink()
    with pytest.raises(GtlayoutError, match="sparse/0 is incomplete"):
        load_scene(tiny)


@pytest.mark.parametrize("change", [lambda camera: camera, _in_another_world])
def test_formats_that_agree(tiny: Path, frames: list[Frame], change: Change) -> None:
    """The same but for the world: the one with more images is read, and named."""
    write_colmap(tiny / "sparse/0", frames[:4])
    write_transforms(tiny / "transforms.json", _changed(frames, change))
    source, cameras = read_cameras(tiny)
    assert source.path == tiny / "transforms.json"
    assert len(cameras.images) == 5
    (warning,) = cameras.warnings
    assert (
        f"{tiny / 'transforms.json'} (nerfstudio) with 5 images was read, not {tiny / 'sparse/0'} (COLMAP) with 4"
        in warning
    )


def test_a_metric_source_goes_first(tiny: Path, frames: list[Frame]) -> None:
    write_colmap(tiny / "sparse/0", frames)
    (tiny / "pose").mkdir()
    (tiny / "intrinsic").mkdir()
    K = np.eye(4)
    K[:3, :3] = frames[0].camera.K
    K[:2, 2] -= 0.5
    np.savetxt(tiny / "intrinsic/intrinsic_color.txt", K)
    (tiny / "images").rename(tiny / "color")
    (tiny / "images").symlink_to(tiny / "color")
    for frame in frames:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = frame.camera.R_cam_from_world.T, frame.camera.center_world
        np.savetxt(tiny / f"pose/{frame.image_path.stem}.txt", pose)
    source, cameras = read_cameras(tiny)
    assert (source.reader.name, cameras.metric) == ("ScanNet", True)


def _tenth_longer(camera: Camera) -> Camera:
    return replace(camera, K=camera.K @ np.diag([1.1, 1.1, 1]))


def _second_turned(camera: Camera) -> Camera:
    turn = _rotation(np.array([0, np.deg2rad(3), 0]))
    return camera.placed(turn @ camera.R_cam_from_world, camera.center_world) if camera.center_world[0] > 0 else camera


def _stretched(camera: Camera) -> Camera:
    return camera.placed(camera.R_cam_from_world, camera.center_world * (1.2, 1, 1))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (_tenth_longer, "their lenses differ by .* % of the focal length"),
        (_second_turned, "their poses differ by up to .*°"),
        (_stretched, "their positions differ by up to .* % of the camera's path"),
    ],
)
def test_formats_that_contradict_each_other(tiny: Path, frames: list[Frame], change: Change, says: str) -> None:
    write_colmap(tiny / "sparse/0", frames)
    write_transforms(tiny / "transforms.json", _changed(frames, change))
    with pytest.raises(GtlayoutError, match=rf"sparse/0 \(COLMAP\), .*transforms.json \(nerf.*: {says}.*; {CHOOSE}"):
        load_scene(tiny)
    assert load_scene(tiny, cameras=tiny / "sparse/0").warnings == ()
    chosen = load_scene(tiny, cameras=tiny / "transforms.json").frames[0].camera
    np.testing.assert_allclose(chosen.center_world, change(frames[0].camera).center_world, atol=1e-9)


def test_formats_of_other_images_contradict_each_other(tiny: Path, frames: list[Frame]) -> None:
    write_colmap(tiny / "sparse/0", frames[:3])
    write_transforms(tiny / "transforms.json", frames[2:])
    with pytest.raises(GtlayoutError, match="they have 1 images in common"):
        load_scene(tiny)


def test_a_camera_that_only_turns_agrees_with_itself(tiny: Path, frames: list[Frame]) -> None:
    still = _changed(frames, lambda camera: camera.placed(camera.R_cam_from_world, np.array([1.0, 2, 3])))
    write_colmap(tiny / "sparse/0", still)
    write_transforms(tiny / "transforms.json", _changed(still, _in_another_world))
    assert len(load_scene(tiny).frames) == 5
    write_transforms(tiny / "transforms.json", frames)
    with pytest.raises(GtlayoutError, match=r"positions differ by up to 1e.02 % of the camera's path"):
        load_scene(tiny)


def test_lenses_are_compared_whatever_the_size_of_the_images(tiny: Path, frames: list[Frame]) -> None:
    write_transforms(tiny / "transforms.json", frames)
    images = read_cameras(tiny)[1].images
    large = [
        replace(image, camera=image.camera.rescaled(3 * image.camera.width, 3 * image.camera.height))
        for image in images
    ]
    assert contradiction(images, large) is None


@pytest.mark.parametrize("named", ["sparse/1", "sparse/1/images.txt", "other", "other/train.json"])
def test_a_named_source_is_read_whatever_else_is_there(tiny: Path, frames: list[Frame], named: str) -> None:
    """By a path, or by one within the scene folder; a model by its folder or by a file of it."""
    write_colmap(tiny / "sparse/0", frames)
    write_colmap(tiny / "sparse/1", frames[:4])
    write_transforms(tiny / "transforms.json", frames[:4])
    shutil.copytree(tiny / "sparse/1", tiny / "other")
    if named.endswith(".json"):
        (tiny / "transforms.json").rename(tiny / named)
    for path in (tiny / named, Path(named)):
        scene = gtlayout.load(tiny, cameras=path)
        assert len(scene.frames) == 4
        assert scene.warnings == ()


@pytest.mark.parametrize(
    ("named", "says"),
    [
        ("gone", "no cameras gone"),
        ("annotations.json", "no cameras in .*annotations.json; looked for sparse/0"),
        ("images", "no cameras in .*images; looked for"),
    ],
)
def test_a_named_file_that_is_no_source_is_refused(tiny: Path, named: str, says: str) -> None:
    with pytest.raises(GtlayoutError, match=says):
        load_scene(tiny, cameras=Path(named))


def test_two_annotation_files(tiny: Path) -> None:
    data = json.loads((tiny / "annotations.json").read_text())
    (tiny / "second.json").write_text(json.dumps({**data, "frames": data["frames"][:1]}))
    with pytest.raises(
        GtlayoutError, match=r"annotations.json \(native\), .*second.json \(native\); choose with --ann"
    ):
        load_scene(tiny)
    assert [len(load_scene(tiny, Path(name)).key_frames) for name in ("annotations.json", "second.json")] == [2, 1]


def test_cameras_in_a_zip_are_refused_by_name(tiny: Path) -> None:
    with zipfile.ZipFile(tiny / "model.zip", "w") as archive:
        archive.writestr("cameras.txt", "")
    for name in ("model.zip", "model.zip/cameras.txt"):
        with pytest.raises(GtlayoutError, match=rf"no cameras in .*{name}; looked for "):
            load_scene(tiny, cameras=Path(name))


@pytest.mark.parametrize("annotated", [True, False])
def test_named_annotations_are_never_ignored(tiny: Path, annotated: bool) -> None:
    (tiny / "notes.txt").write_text("wall, floor")
    with pytest.raises(
        GtlayoutError, match=r"no annotations in .*: notes.txt is no file of a known tool \(known are: n"
    ):
        load_scene(tiny, Path("notes.txt"), annotated=annotated)
    with pytest.raises(GtlayoutError, match=r"no annotations gone\.xml"):
        load_scene(tiny, Path("gone.xml"), annotated=annotated)


def test_the_commands_choose(tiny: Path, frames: list[Frame], capsys: pytest.CaptureFixture[str]) -> None:
    write_colmap(tiny / "sparse/0", frames)
    write_transforms(tiny / "transforms.json", _changed(frames, _tenth_longer))
    shutil.copy(tiny / "annotations.json", tiny / "second.json")
    chosen = ["--cameras", str(tiny / "sparse/0"), "--annotations", "second.json"]
    for command in (["check"], ["solve"], ["import"], ["evaluate"], ["report"], ["export", "--to", "svg"]):
        out = [str(tiny.parent / "out")] if command == ["import"] else []
        assert main([command[0], str(tiny), *out, *command[1:]]) == 1
        assert "contradict each other" in capsys.readouterr().err
        main([command[0], str(tiny), *out, *command[1:], *chosen])
        err = capsys.readouterr().err
        assert "contradict" not in err
        assert "more than one place" not in err
    assert len(load_scene(tiny.parent / "out").frames) == 5
    assert main(["import", str(tiny), str(tiny.parent / "again"), "--colmap", *chosen]) == 1
    assert "from --colmap or from --cameras" in capsys.readouterr().err
