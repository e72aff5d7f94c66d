"""RealEstate10k cameras with images or with a video; CAD-Estate with a video; written and read back."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import SHARED_DATA
from videos import number_in, pictures, write_video

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.re10k import read_cameras, write_re10k
from gtlayout.io.pixels.exports import write_jpeg
from gtlayout.io.pixels.images import read_gray, read_rgb
from gtlayout.io.pixels.video import Video
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.writing.scene_writers import write_scene
from gtlayout.method import solve
from gtlayout.scene import Camera, Frame, ImageArray, Scene
from gtlayout.solution import Solution
from gtlayout.tracking.config import TrackingConfig
from gtlayout.tracking.track import track

URL = "https://www.youtube.com/watch?v=0"
SIZE = (160, 96)
COUNT = 12
TIMES_US = [1_000_000 * i // 30 for i in range(COUNT)]
CLIPS = sorted((SHARED_DATA / "re10k_cameras").glob("*.txt"))


def camera(i: int) -> Camera:
    K = np.array([[150.3, 0, 80.7], [0, 149.1, 47.9], [0, 0, 1]])
    rotation = cv2.Rodrigues(np.array([0.01 * i, 0.02 * i, 0.3]))[0].astype(np.float64)
    return Camera(K, rotation, np.array([0.1 * i, 1 / 3, 0.7]), *SIZE)


def frames_of(count: int = COUNT) -> list[Frame]:
    return [Frame(f"{i}.jpg", Path(f"{i}.jpg"), camera(i)) for i in range(count)]


def make_scene(root: Path, annotated: Sequence[str], times_us: Sequence[int] = TIMES_US) -> Path:
    """Cameras and annotations; images or a video are still to come."""
    write_re10k(root / "clip.txt", frames_of(len(times_us)), times_us, URL)
    wall = {"id": "e0", "label": "wall", "polygons": [[[0, 0], [160, 0], [160, 96], [0, 96]]], "visible": []}
    key_frames = [{"image": name, "elements": [wall], "occlusion_edges": []} for name in annotated]
    data = {"format": "gtlayout-annotations/1", "image_size": list(SIZE), "frames": key_frames}
    (root / "annotations.json").write_text(json.dumps(data))
    return root


def write_images(folder: Path, names: Sequence[str]) -> None:
    folder.mkdir(exist_ok=True)
    for name, image in zip(names, pictures(len(names)), strict=True):
        cv2.imwrite(str(folder / name), image)


def numbers_read(scene: Scene) -> list[int]:
    return [number_in(read_rgb(frame)) for frame in scene.frames]


@pytest.mark.parametrize("path", CLIPS or [None], ids=lambda path: path.stem if path else "none")
def test_real_cameras_come_back(path: Path | None, tmp_path: Path) -> None:
    """To the last bit but that of a division by the size, and of a rotation made orthonormal twice."""
    if path is None:
        pytest.skip("the real camera files are not beside the checkout")
    cameras = read_cameras(path)
    frames = []
    for i, one in enumerate(cameras):
        K = np.diag([*np.multiply(one.focal_shares, (1280, 720)), 1.0])
        K[:2, 2] = np.multiply(one.center_shares, (1280, 720))
        frames.append(Frame(str(i), Path(), Camera(K, one.R_cam_from_world, one.t_cam_from_world, 1280, 720)))
    write_re10k(tmp_path / "clip.txt", frames, [one.timestamp_us for one in cameras], URL)
    read = read_cameras(tmp_path / "clip.txt")
    assert [one.timestamp_us for one in read] == [one.timestamp_us for one in cameras]
    for a, b in zip(cameras, read, strict=True):
        assert np.array_equal(b.t_cam_from_world, a.t_cam_from_world)
        np.testing.assert_allclose(b.R_cam_from_world, a.R_cam_from_world, rtol=0, atol=2e-15)
        np.testing.assert_allclose([b.focal_shares, b.center_shares], [a.focal_shares, a.center_shares], rtol=3e-16)


@pytest.mark.parametrize(
    ("folder", "pattern", "jitter_us"),
    [("images", "{}.jpg", 0), ("images", "vi_d-eo_{}.png", 2999), ("", "{}.jpeg", -3000), ("clip", "v_{}.JPG", 1)],
)
def test_images_are_found_by_their_time(folder: str, pattern: str, jitter_us: int, tmp_path: Path) -> None:
    names = [pattern.format(us + jitter_us * (us > 3000)) for us in TIMES_US]
    write_images(tmp_path / folder, names)
    # A video, and the images of another one, do not count.
    write_video(tmp_path / "a.mp4", pictures(COUNT)[::-1])
    write_images(tmp_path / folder, [f"other_{us}.jpg" for us in TIMES_US[:3]])
    scene = load_scene(make_scene(tmp_path, names[2:4]))
    assert [frame.name for frame in scene.frames] == names
    assert numbers_read(scene) == list(range(COUNT))
    assert [w for w in scene.warnings if "visible" not in w] == []
    assert [key.frame for key in scene.key_frames] == [2, 3]
    assert not scene.metric
    for i, frame in enumerate(scene.frames):
        np.testing.assert_allclose(frame.camera.K, camera(i).K, rtol=1e-15)
        np.testing.assert_allclose(frame.camera.R_cam_from_world, camera(i).R_cam_from_world, atol=1e-15)
        assert np.array_equal(frame.camera.t_cam_from_world, camera(i).t_cam_from_world)


def test_images_off_in_time_are_told_of(tmp_path: Path) -> None:
    write_images(tmp_path / "images", [f"{us + 40_000}.jpg" for us in TIMES_US])
    make_scene(tmp_path, ["66666.jpg"])
    # By 40 ms, which is 6.7 ms from the next camera: nothing matches.
    with pytest.raises(
        GtlayoutError, match=r"^[^\n]*clip\.txt: no image .* 12 frames; looked for .*off by about 40 ms"
    ):
        load_scene(tmp_path)
    shutil.copy(tmp_path / "images/40000.jpg", tmp_path / "images/0.jpg")
    for i in (1, 2):
        shutil.copy(tmp_path / "images/40000.jpg", tmp_path / f"images/{TIMES_US[i]}.jpg")
    warnings = load_scene(tmp_path).warnings
    assert any("off by about 40 ms" in w and "9 of 12 cameras have none within 3 ms" in w for w in warnings)


def test_no_image_is_given_to_two_cameras(tmp_path: Path) -> None:
    times_us = [*TIMES_US[:6], TIMES_US[5] + 1500, *TIMES_US[6:]]
    write_images(tmp_path / "images", [f"{us}.jpg" for us in TIMES_US])
    scene = load_scene(make_scene(tmp_path, ["33333.jpg"], times_us))
    assert len(scene.frames) == COUNT
    assert any("1 cameras are left out: another is nearer" in w for w in scene.warnings)


def test_frames_of_a_video_are_found_by_their_time(tmp_path: Path) -> None:
    every_third = [TIMES_US[i] for i in range(0, COUNT, 3)]
    write_video(tmp_path / "v.mp4", pictures(COUNT))
    root = make_scene(tmp_path, [f"{every_third[1]}.jpg"], every_third)
    scene = load_scene(root)
    assert [frame.name for frame in scene.frames] == [f"{us}.jpg" for us in every_third]
    assert [frame.video.index for frame in scene.frames if frame.video] == [0, 3, 6, 9]
    assert numbers_read(scene) == [0, 3, 6, 9]
    assert len({id(frame.video.video) for frame in scene.frames if frame.video}) == 1
    assert not any("clip.txt" in w for w in scene.warnings)
    assert read_gray(scene.frames[1]).shape == (96, 160)
    write_jpeg(tmp_path / "out.jpg", scene.frames[2])
    written = cv2.imread(str(tmp_path / "out.jpg"))
    assert written is not None
    assert number_in(written.astype(np.uint8)) == 6
    write_scene(scene, tmp_path / "export/vi_0", "cad-estate", "native")
    assert len(list((tmp_path / "export/vi_0/vi").glob("*.jpg"))) == 4


def test_a_video_a_little_off_is_taken_with_a_warning(tmp_path: Path) -> None:
    write_video(tmp_path / "v.mkv", pictures(COUNT))
    scene = load_scene(make_scene(tmp_path, ["10000.jpg"], [us + 10_000 for us in TIMES_US]))
    assert numbers_read(scene) == list(range(COUNT))
    assert any("v.mkv are -10." in w and "ms off the cameras' timestamps (median)" in w for w in scene.warnings)


def test_a_video_cut_out_of_a_longer_one_is_one_clear_line(tmp_path: Path) -> None:
    write_video(tmp_path / "v.mp4", pictures(COUNT))
    make_scene(tmp_path, ["0.jpg"], [us + 71_000_000 for us in TIMES_US])
    with pytest.raises(
        GtlayoutError, match=r"^[^\n]*clip\.txt: no frame of [^\n]*v\.mp4 [^\n]*off by about -71\.000 s"
    ):
        load_scene(tmp_path)


def test_no_frame_of_a_video_is_given_to_two_cameras(tmp_path: Path) -> None:
    write_video(tmp_path / "v.mp4", pictures(COUNT)[::2], stamps_ms=[us // 1000 for us in TIMES_US[::2]])
    scene = load_scene(make_scene(tmp_path, ["0.jpg"]))
    assert [frame.video.index for frame in scene.frames if frame.video] == list(range(COUNT // 2))
    assert any("cameras are left out: another is nearer" in w for w in scene.warnings)


@pytest.mark.parametrize("wrong", ["two videos", "no video", "size", "damaged"])
def test_what_is_wrong_is_one_clear_line(wrong: str, tmp_path: Path) -> None:
    make_scene(tmp_path, ["0.jpg"])
    if wrong == "damaged":
        (tmp_path / "v.mp4").write_bytes(b"\x00" * 100)
    elif wrong == "size":
        write_video(tmp_path / "v.mp4", [image[:, :80] for image in pictures(COUNT)])
    elif wrong == "two videos":
        for name in ("v.mp4", "w.MOV"):
            write_video(tmp_path / name.lower(), pictures(1))
            (tmp_path / name.lower()).rename(tmp_path / name)
    says = {
        "two videos": r"more than one video: .*v\.mp4, .*w\.MOV",
        "no video": r"clip\.txt: no image .* 12 frames; looked for .*images/0\.jpg .* one video \(\.mp4",
        "size": r"0\.jpg was annotated at 160x96 px but its camera says 80x96",
        "damaged": r"cannot read video .*v\.mp4: damaged",
    }
    with pytest.raises(GtlayoutError, match=rf"^[^\n]*{says[wrong]}[^\n]*$"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    ("times_us", "url"),
    [([0, 1, 1, 3], URL), ([0, 2, 1, 3], URL), ([0, 1, 2, 3], "no address"), ([0, 1, 2, 3], "a://\n")],
)
def test_what_cannot_be_read_back_is_not_written(times_us: list[int], url: str, tmp_path: Path) -> None:
    with pytest.raises(GtlayoutError, match=r"^cannot write .*clip\.txt"):
        write_re10k(tmp_path / "clip.txt", frames_of(4), times_us, url + url * url.endswith("\n"))
    assert not (tmp_path / "clip.txt").exists()


def test_other_text_files_are_no_cameras(tmp_path: Path) -> None:
    write_images(tmp_path / "images", [f"{us}.jpg" for us in TIMES_US])
    make_scene(tmp_path, ["0.jpg"])
    (tmp_path / "README.txt").write_text("see https://example.org\n")
    (tmp_path / "points3D.txt").write_text("# https://colmap.github.io\n")
    (tmp_path / "binary.txt").write_bytes(bytes(range(256)) * 100)
    assert len(load_scene(tmp_path).frames) == COUNT


def test_cad_estate_takes_a_video_too(
    tmp_path: Path, edit_json: Callable[[Path, Callable[[Any], object]], None]
) -> None:
    times_us = [33_333 * i for i in range(COUNT)]
    write_images(tmp_path / "images", [f"{us}.jpg" for us in times_us])
    scene = load_scene(make_scene(tmp_path, ["99999.jpg"], times_us))
    clip = tmp_path / "vi-d_eo_0"
    write_scene(scene, clip, "cad-estate", "native")
    images = load_scene(clip)
    shutil.rmtree(clip / "vi-d_eo")
    write_video(clip / "any.webm", pictures(COUNT), codec="libvpx-vp9", options={"deadline": "realtime"})
    read = load_scene(clip)
    assert [frame.name for frame in read.frames] == [frame.name for frame in images.frames]
    assert numbers_read(read) == list(range(COUNT))
    assert [key.frame for key in read.key_frames] == [3]
    for a, b in zip(images.frames, read.frames, strict=True):
        assert np.array_equal(a.camera.K, b.camera.K)
    edit_json(clip / "frames.json", lambda data: data["frames"][0].update(timestamp=10**400))
    with pytest.raises(GtlayoutError, match=r"^[^\n]*frames\.json: frame number 0 has no timestamp[^\n]*$"):
        load_scene(clip)


@pytest.fixture(scope="module")
def clip_with_video(room: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The synthetic room as a RealEstate10k clip: cameras as text, images as a video."""
    root = tmp_path_factory.mktemp("video") / "room"
    root.mkdir()
    scene = load_scene(room)
    times_us = [1_000_000 * i // 30 for i in range(len(scene.frames))]
    write_re10k(root / "clip.txt", scene.frames, times_us, URL)
    bgr = [cv2.cvtColor(read_rgb(frame), cv2.COLOR_RGB2BGR).astype(np.uint8) for frame in scene.frames]
    write_video(root / "room.mp4", bgr, options={"crf": "10", "bf": "3", "g": "12"})
    data = json.loads((room / "annotations.json").read_text())
    called = {frame.name: f"{us}.jpg" for frame, us in zip(scene.frames, times_us, strict=True)}
    for key_frame in data["frames"]:
        key_frame["image"] = called[key_frame["image"]]
    (root / "annotations.json").write_text(json.dumps(data))
    (root / "scene.json").write_text('{"metric": true}')
    return root


def test_a_room_solves_from_its_video(room_solution: Solution, clip_with_video: Path) -> None:
    images, video = room_solution, solve(load_scene(clip_with_video))
    assert [one.label for one in video.layout.instances] == [one.label for one in images.layout.instances]
    for a, b in zip(images.layout.planes, video.layout.planes, strict=True):
        assert np.degrees(np.arccos(np.clip(a.normal @ b.normal, -1, 1))) < 0.3
        assert abs(a.d - b.d) < 0.03


def test_tracking_decodes_a_video_once_and_forward(clip_with_video: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load_scene(clip_with_video)
    read: list[int] = []
    frame = Video.frame

    def noted(self: Video, index: int) -> ImageArray:
        read.append(index)
        return frame(self, index)

    monkeypatch.setattr(Video, "frame", noted)
    monkeypatch.setattr(Video, "_seek", lambda self, key: pytest.fail("it seeks"))
    config = replace(TrackingConfig(), max_frames=6)
    tracks = track(scene, config, seed=0)
    assert read == sorted(set(read))
    monkeypatch.undo()
    # Images in any order lead to the same tracks: only the reading differs.
    cached = replace(scene, frames=tuple(replace(one, video=None) for one in scene.frames))
    monkeypatch.setattr(
        "gtlayout.tracking.image_cache.read_gray", lambda one: read_gray(scene.frames[cached.frames.index(one)])
    )
    assert np.array_equal(track(cached, config, seed=0).points_px, tracks.points_px)
