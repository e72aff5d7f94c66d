"""load_scene: the real clips, three ways to write one camera path, and every bad scene folder."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scene_checks import assert_one_camera_skipped

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.colmap.reader import write_colmap
from gtlayout.io.cameras.nerfstudio import write_transforms
from gtlayout.io.pixels.images import read_depth, read_gray, read_rgb
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import Camera, Frame, Scene

Edit = Callable[[Path, Callable[[Any], object]], None]


def test_real_clip_loads_whole(real_clip: Path) -> None:
    scene = load_scene(real_clip)
    raw = json.loads((real_clip / "annotations.json").read_text())["frames"]
    assert len(scene.frames) == {"office": 50, "redkitchen": 240}[real_clip.name]
    assert [scene.frame_of(k).name for k in range(8)] == [frame["image"] for frame in raw]
    assert [len(key.elements) for key in scene.key_frames] == [len(frame["elements"]) for frame in raw]
    assert [len(key.occlusion_edges) for key in scene.key_frames] == [len(frame["occlusion_edges"]) for frame in raw]
    assert scene.metric
    assert scene.warnings == ()
    assert sum(frame.depth_path is not None for frame in scene.frames) == 8
    first = {"office": (-1.94312, 0.112340, 4.67999), "redkitchen": (-0.328331, 0.363398, -0.219623)}[real_clip.name]
    rounding_m = 2e-5
    np.testing.assert_allclose(scene.frames[0].camera.center_world, first, atol=rounding_m)


def test_real_depth_lies_on_the_true_planes(real_clip: Path) -> None:
    """Pose direction, axes, pixel centres and depth unit at once: depth unprojects onto the floor's true plane."""
    scene = load_scene(real_clip)
    truth = json.loads((real_clip / "gt_planes.json").read_text())
    floor = truth["planes"]["floor"]
    residuals = []
    for key_frame in scene.key_frames:
        frame = scene.frames[key_frame.frame]
        depth = read_depth(frame)
        for element in key_frame.elements:
            if truth["elements"][frame.name].get(element.id) != "floor" or element.visible.is_empty:
                continue
            mask = np.zeros(depth.shape, dtype=np.uint8)
            for polygon in element.visible.geoms:
                cv2.fillPoly(mask, [np.round(np.array(polygon.exterior.coords) - 0.5).astype(np.int32)], (1,))
            v, u = np.nonzero((mask > 0) & np.isfinite(depth))
            camera = frame.camera
            points = camera.center_world + depth[v, u, None] * camera.rays_world(np.column_stack([u + 0.5, v + 0.5]))
            residuals.append(points @ np.array(floor["normal"]) + floor["d"])
    distance = np.abs(np.concatenate(residuals))
    assert len(distance) > 10_000
    assert np.median(distance) < 0.02


def test_colmap_text_binary_and_transforms_agree(tiny: Path) -> None:
    frames = _random_frames(tiny)
    (tiny / "transforms.json").unlink()
    scenes = []
    ways: list[Callable[[Path], None]] = [
        lambda root: write_colmap(root / "sparse/0", frames),
        lambda root: write_colmap(root / "sparse", frames, binary=True),
        lambda root: write_transforms(root / "transforms.json", frames),
    ]
    for write in ways:
        write(tiny)
        scenes.append(load_scene(tiny))
        shutil.rmtree(tiny / "sparse", ignore_errors=True)
    for scene in scenes:
        assert scene.warnings == ()
        for read, written in zip(scene.frames, frames, strict=True):
            assert (read.name, read.image_path) == (written.name, written.image_path)
            assert (read.camera.width, read.camera.height) == (64, 48)
            np.testing.assert_allclose(read.camera.K, written.camera.K, atol=1e-9)
            np.testing.assert_allclose(read.camera.R_cam_from_world, written.camera.R_cam_from_world, atol=1e-9)
            np.testing.assert_allclose(read.camera.t_cam_from_world, written.camera.t_cam_from_world, atol=1e-9)


def test_opengl_axes(tiny: Path) -> None:
    """With camera-to-world = identity, OpenGL looks along -z, x right, y up."""
    frame = load_scene(tiny).frames[0]
    pixels, depth = frame.camera.project(np.array([[0.5, 0.25, -2.0]]))
    np.testing.assert_allclose(pixels, [[32 + 60 * 0.25, 24 - 60 * 0.125]])
    np.testing.assert_allclose(depth, [2.0])


def test_frames_come_in_natural_order(tiny: Path, edit_json: Edit) -> None:
    names = ["9.png", "10.png", "100.png", "8.png", "1.png"]
    for i, name in enumerate(names):
        (tiny / f"images/{i:03d}.png").rename(tiny / "images" / name)
    edit_json(
        tiny / "transforms.json",
        lambda d: [f.update(file_path=f"./images/{n[:-4]}") for f, n in zip(d["frames"], names, strict=True)],
    )
    edit_json(
        tiny / "annotations.json",
        lambda d: [d["frames"][i].update(image=n) for i, n in enumerate(["100.png", "9.png"])],
    )
    scene = load_scene(tiny)
    assert [frame.name for frame in scene.frames] == ["1.png", "8.png", "9.png", "10.png", "100.png"]
    assert [scene.frame_of(k).name for k in (0, 1)] == ["9.png", "100.png"]


def test_metric_by_depth_or_by_word(tiny: Path) -> None:
    assert not load_scene(tiny).metric
    (tiny / "depth").mkdir()
    assert "holds no map" in load_scene(tiny).warnings[0]
    depth_mm = np.full((48, 64), 1234, dtype=np.uint16)
    depth_mm[0, 0] = 0
    (tiny / "depth/001.png").write_bytes(cv2.imencode(".png", depth_mm)[1].tobytes())
    scene = load_scene(tiny)
    assert scene.metric
    depth = read_depth(scene.frame_of(0))
    assert np.isnan(depth[0, 0])
    assert depth[1, 1] == np.float32(1.234)
    (tiny / "scene.json").write_text('{"metric": false}')
    assert not load_scene(tiny).metric
    (tiny / "scene.json").write_text('{"Metric": true}')
    _fails(tiny, "scene.json")


def test_missing_images_are_counted(tiny: Path) -> None:
    (tiny / "images/000.png").unlink()
    scene = load_scene(tiny)
    assert len(scene.frames) == 4
    assert scene.frame_of(0).name == "001.png"
    assert scene.warnings[0].startswith("1 of 5 cameras have no image file")


def test_unreadable_image_fails_only_when_read(tiny: Path) -> None:
    whole = (tiny / "images/002.png").read_bytes()
    for damaged in (b"", b"no image", whole[: len(whole) // 2]):
        (tiny / "images/002.png").write_bytes(damaged)
        scene = load_scene(tiny)
        for read in (read_gray, read_rgb):
            with pytest.raises(GtlayoutError, match=r"002\.png"):
                read(scene.frames[2])
        assert read_gray(scene.frames[3]).shape == (48, 64)


def test_rgb_is_rgb(tiny: Path) -> None:
    bgr = np.zeros((48, 64, 3), dtype=np.uint8)
    bgr[..., 0] = 200
    (tiny / "images/000.png").write_bytes(cv2.imencode(".png", bgr)[1].tobytes())
    assert read_rgb(load_scene(tiny).frames[0])[0, 0].tolist() == [0, 0, 200]


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (lambda r: (r / "transforms.json").unlink(), "no cameras in .* transforms.json"),
        (lambda r: (r / "annotations.json").unlink(), "no annotations in .* annotations.json"),
        (lambda r: (r / "transforms.json").write_text("{"), "transforms.json is not valid JSON"),
        (lambda r: (r / "transforms.json").write_text('{"frames": []}'), "transforms.json has no frames"),
        (lambda r: shutil.rmtree(r / "images"), "no image file for any of 5 cameras; looked for .*images/000.png"),
        (lambda r: [(r / f"images/{i:03d}.png").unlink() for i in (0, 2, 4)], "2 frames with camera and image file"),
        (lambda r: write_colmap(r / "sparse/0", _random_frames(r)), r"sparse/0 \(COLMAP\), .*transforms.json \(nerf"),
    ],
)
def test_incomplete_folder(tiny: Path, break_it: Callable[[Path], object], says: str) -> None:
    break_it(tiny)
    _fails(tiny, says)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["frames"][2].update(transform_matrix=[[1, 0], [0, 1]]), "frame images/002.png: transform_matrix"),
        (lambda d: d["frames"][2]["transform_matrix"][0].__setitem__(3, float("nan")), "images/002.png: .*finite"),
        (lambda d: d["frames"][2]["transform_matrix"][0].__setitem__(0, 1.1), "images/002.png: .*no rotation"),
        (lambda d: d["frames"][2]["transform_matrix"][0].__setitem__(0, -1), "images/002.png: .* is mirrored"),
        (lambda d: d["frames"][2].update(file_path="../002.png"), "leads out of the scene folder"),
        (lambda d: d["frames"][2].update(file_path="/etc/002.png"), "must be relative"),
        (lambda d: d["frames"][2].pop("file_path"), "frame number 2 has no file_path"),
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
        (lambda d: [d.pop("fl_x"), d.pop("fl_y")], "frame images/000.png: no fl_x"),
        (lambda d: d.update(k1="a"), "k1 must be a finite number"),
        (lambda d: d.update(camera_model="EQUIRECTANGULAR"), "camera_model 'EQUIRECTANGULAR' is not supported"),
        (lambda d: d.update(k4=0.1), "k4 is supported for OPENCV_FISHEYE and FULL_OPENCV only"),
        (
            lambda d: d.update(w=63),
            "000.png: its camera is for images of 63x48 px, but this one is 64x48, another shape",
        ),
    ],
)
def test_bad_transforms(tiny: Path, edit_json: Edit, change: Callable[[Any], object], says: str) -> None:
    edit_json(tiny / "transforms.json", change)
    _fails(tiny, says)


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (lambda m: (m / "points3D.txt").unlink(), "sparse/0 is incomplete: no points3D"),
        (lambda m: (m / "cameras.txt").write_text("1 PINHOLE 64\n"), r"sparse/0/cameras\.txt, line 1 is no camera"),
        (lambda m: (m / "images.txt").write_text(""), "sparse/0"),
        (lambda m: _edit(m / "cameras.txt", "PINHOLE 64 48 60 60", "PINHOLE 64 48 0 60"), "no valid size and focal"),
    ],
)
def test_bad_colmap(tiny: Path, break_it: Callable[[Path], object], says: str) -> None:
    write_colmap(tiny / "sparse/0", load_scene(tiny).frames)
    (tiny / "transforms.json").unlink()
    break_it(tiny / "sparse/0")
    _fails(tiny, says)


def test_text_and_binary_of_one_model(tiny: Path) -> None:
    frames = load_scene(tiny).frames
    (tiny / "transforms.json").unlink()
    write_colmap(tiny / "sparse/0", frames)
    write_colmap(tiny / "sparse/0", frames, binary=True)
    assert "the binary model was read" in load_scene(tiny).warnings[0]


def test_old_colmap_without_rigs(tiny: Path) -> None:
    frames = load_scene(tiny).frames
    (tiny / "transforms.json").unlink()
    write_colmap(tiny, frames)
    for part in ("rigs.txt", "frames.txt"):
        (tiny / part).unlink()
    np.testing.assert_allclose(load_scene(tiny).frames[4].camera.center_world, frames[4].camera.center_world, atol=1e-9)


def test_writing_png_survives_the_import_order() -> None:
    """pycolmap brings a zlib of its own: loaded before NumPy it makes OpenCV's PNG encoder crash."""
    code = "import gtlayout.io, cv2, numpy; assert cv2.imencode('.png', numpy.zeros((9, 9), 'uint16'))[0]"
    subprocess.run([sys.executable, "-c", code], check=True)


def _random_frames(root: Path) -> list[Frame]:
    """Frames over the tiny scene's images with poses in general position."""
    rng = np.random.default_rng(1)
    K = np.array([[61.25, 0, 30.5], [0, 62.75, 25.125], [0, 0, 1]])
    frames = []
    for i in range(5):
        rotation = cv2.Rodrigues(rng.normal(size=3))[0].astype(np.float64)
        camera = Camera(K, rotation, rng.normal(size=3) * 3, 64, 48)
        frames.append(Frame(f"{i:03d}.png", root / f"images/{i:03d}.png", camera))
    return frames


def _edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def _fails(root: Path, says: str) -> Scene | None:
    with pytest.raises(GtlayoutError, match=says) as caught:
        load_scene(root)
    assert "\n" not in str(caught.value)
    return None
