"""``video_frames.json``: what is drawn on a video finds the images that were made of it, and its place in them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import jsonschema
import numpy as np
import pytest
from videos import cvat_video, pictures, write_video

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.cameras.upright import Upright
from gtlayout.io.json_schema import schema_of
from gtlayout.io.pixels.turn import TURNS
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.video_record import FILE, VideoRecord, with_origins, write_video_record
from gtlayout.io.writing.scene_writers import write_scene
from gtlayout.scene import FloatArray, VideoOrigin

Edit = Callable[[Path, Callable[[Any], object]], None]
LENS = Undistortion("SIMPLE_RADIAL", 66, 50, (60.0, 33.0, 25.0, -0.1))
"""Its undistorted image is the tiny scene's, up to its size."""


def record(size: tuple[int, int] = (64, 48), orientation: int = 1, **changes: Any) -> dict[str, Any]:
    """Of the tiny scene, as if every tenth frame of a video were taken."""
    frames = [{"image": f"{i:03d}.png", "number": 10 * i, "time_s": i / 3, "lenses": []} for i in range(5)]
    whole = {"format": "gtlayout-video/1", "video": "clip.mp4", "frame_count": 50, "image_size": list(size)}
    return {**whole, "orientation": orientation, "lenses": [], "frames": frames, **changes}


def drawn(scene_folder: Path) -> dict[str, FloatArray]:
    """Corners of the first element of each key frame, by image."""
    scene = load_scene(scene_folder)
    return {
        scene.frame_of(k).name: np.array(key.elements[0].amodal.geoms[0].exterior.coords)[:-1]
        for k, key in enumerate(scene.key_frames)
    }


def same_corners(found: FloatArray, expected: FloatArray) -> bool:
    near = np.linalg.norm(found[:, None] - expected[None], axis=2)
    return len(found) == len(expected) and bool(np.all(near.min(axis=0) < 1e-3))


SQUARE = np.array([[20.0, 12.0], [45.0, 14.0], [44.0, 38.0], [18.0, 35.0]])


def annotate_video(scene: Path, number: int, size: tuple[int, int], points: FloatArray = SQUARE) -> None:
    (scene / "annotations.json").unlink(missing_ok=True)
    (scene / "annotations.xml").write_text(cvat_video({number: points}, size, 50))


def test_a_drawing_on_the_video_moves_through_its_lens(tiny: Path, edit_json: Edit) -> None:
    width, height = int(LENS.target.width), int(LENS.target.height)
    K = LENS.target.K
    # The tiny scene's images as if they had been undistorted to this camera.
    for path in sorted((tiny / "images").iterdir()):
        cv2.imwrite(str(path), np.zeros((height, width, 3), dtype=np.uint8))
    edit_json(
        tiny / "transforms.json",
        lambda d: d.update(w=width, h=height, fl_x=K[0, 0], fl_y=K[1, 1], cx=K[0, 2], cy=K[1, 2]),
    )
    lens = {"model": LENS.model, "width": LENS.width, "height": LENS.height, "params": list(LENS.params)}
    of_video = record((66, 50), lenses=[lens])
    for frame in of_video["frames"]:
        frame["lenses"] = [0]
    (tiny / FILE).write_text(json.dumps(of_video))
    annotate_video(tiny, 30, (66, 50))
    found = drawn(tiny)
    assert list(found) == ["003.png"]
    assert same_corners(found["003.png"], LENS.points(SQUARE))
    assert not same_corners(found["003.png"], SQUARE)
    # The same file drawn on the images themselves stays where it is.
    points = ";".join(f"{x},{y}" for x, y in SQUARE)
    (tiny / "annotations.xml").write_text(
        f'<annotations><image id="0" name="003.png" width="{width}" height="{height}">'
        f'<polygon label="wall" points="{points}" z_order="0"/></image></annotations>'
    )
    assert same_corners(drawn(tiny)["003.png"], SQUARE)
    # A copy of the video at half the size was drawn on.
    annotate_video(tiny, 30, (33, 25), SQUARE / 2)
    assert same_corners(drawn(tiny)["003.png"], LENS.points(SQUARE))


def test_frames_that_are_not_there_are_named_and_cost_themselves(tiny: Path) -> None:
    (tiny / FILE).write_text(json.dumps(record()))
    (tiny / "annotations.json").unlink()
    (tiny / "annotations.xml").write_text(cvat_video({10: SQUARE, 13: SQUARE}, (64, 48), 50))
    scene = load_scene(tiny)
    assert [scene.frame_of(k).name for k in range(len(scene.key_frames))] == ["001.png"]
    assert any("is frame 13 of clip.mp4" in line and "001.png" in line for line in scene.warnings)
    assert not any("orientation" in line for line in scene.warnings)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_turned_video_may_be_drawn_on_as_shown_or_as_stored(tiny: Path, orientation: int) -> None:
    """The images stand upright, 64x48; players turn what is stored; a tool that does not is told by its size."""
    turn = TURNS[orientation - 1]
    (tiny / FILE).write_text(json.dumps(record(orientation=orientation)))
    annotate_video(tiny, 20, (64, 48))
    assert same_corners(drawn(tiny)["002.png"], SQUARE)
    if turn.swaps_axes:
        annotate_video(tiny, 20, (48, 64), turn.inverse.points(SQUARE, (64, 48)))
        assert same_corners(drawn(tiny)["002.png"], SQUARE)
    assert not any("orientation" in line for line in load_scene(tiny).warnings)


def test_what_is_written_again_remembers_the_video(tiny: Path, tmp_path: Path, edit_json: Edit) -> None:
    """An imported scene imported again, once with a lens of its own: first the video's lens, then that."""
    (tiny / FILE).write_text(json.dumps(record()))
    edit_json(tiny / "transforms.json", lambda d: d.update(k1=-0.1))
    annotate_video(tiny, 40, (64, 48))
    before = drawn(tiny)
    scene = load_scene(tiny)
    write_scene(scene, tmp_path / "again", "native", "native")
    written = json.loads((tmp_path / "again" / FILE).read_text())
    jsonschema.validate(written, schema_of(VideoRecord))
    assert [frame["number"] for frame in written["frames"]] == [0, 10, 20, 30, 40]
    assert [frame["lenses"] for frame in written["frames"]] == [[0]] * 5
    annotate_video(tmp_path / "again", 40, (64, 48))
    assert same_corners(drawn(tmp_path / "again")["004.png"], before["004.png"])
    first = (tmp_path / "again" / FILE).read_bytes()
    write_scene(load_scene(tmp_path / "again"), tmp_path / "third", "native", "native")
    assert (tmp_path / "third" / FILE).read_bytes() == first


def test_lenses_removed_one_after_the_other_are_all_remembered(tiny: Path, tmp_path: Path, edit_json: Edit) -> None:
    lens = {"model": "SIMPLE_RADIAL", "width": 64, "height": 48, "params": [60.0, 32.0, 24.0, 0.1]}
    of_video = record(lenses=[lens])
    width, height = (int(x) for x in Undistortion(*_lens(lens)).target.K[:2, 2] * 2)
    for frame in of_video["frames"]:
        frame["lenses"] = [0]
        cv2.imwrite(str(tiny / "images" / frame["image"]), np.zeros((height, width, 3), dtype=np.uint8))
    (tiny / FILE).write_text(json.dumps(of_video))
    edit_json(tiny / "transforms.json", lambda d: d.update(k1=-0.1, w=width, h=height, cx=width / 2, cy=height / 2))
    annotate_video(tiny, 40, (64, 48))
    before = drawn(tiny)
    write_scene(load_scene(tiny), tmp_path / "again", "native", "native")
    written = json.loads((tmp_path / "again" / FILE).read_text())
    assert [frame["lenses"] for frame in written["frames"]] == [[0, 1]] * 5
    annotate_video(tmp_path / "again", 40, (64, 48))
    assert same_corners(drawn(tmp_path / "again")["004.png"], before["004.png"])


def _lens(of: dict[str, Any]) -> tuple[str, int, int, tuple[float, ...]]:
    return of["model"], of["width"], of["height"], tuple(of["params"])


def test_images_of_several_videos_are_not_recorded(tmp_path: Path) -> None:
    way = Upright(TURNS[0], 64, 48, (), TURNS[0], TURNS[0])
    origins = {f"{name}.jpg": VideoOrigin(f"{name}.mp4", 0, 0.0, 5, way) for name in "ab"}
    write_video_record(tmp_path, origins)
    write_video_record(tmp_path, {})
    assert list(tmp_path.iterdir()) == []
    write_video_record(tmp_path, {"a.jpg": origins["a.jpg"]})
    assert [path.name for path in tmp_path.iterdir()] == [FILE]


def test_frames_read_from_a_video_are_recorded(tmp_path: Path) -> None:
    scene = tmp_path / "scene"
    scene.mkdir()
    write_video(scene / "clip.mp4", pictures(12), options={"crf": "10"})
    line = "{} 0.82 1.09 0.5 0.5 0 0 1 0 0 {} 0 1 0 0 0 0 1 0"
    lines = [line.format(round(i * 1e6 / 30), -0.1 * i) for i in (1, 4, 7, 10)]
    (scene / "clip.txt").write_text("\n".join(["https://www.example.com/watch?v=abc", *lines]) + "\n")
    write_scene(load_scene(scene, annotated=False), tmp_path / "out", "native", "native")
    written = json.loads((tmp_path / "out" / FILE).read_text())
    jsonschema.validate(written, schema_of(VideoRecord))
    assert [frame["number"] for frame in written["frames"]] == [1, 4, 7, 10]
    assert (written["video"], written["frame_count"], written["image_size"]) == ("clip.mp4", 12, [160, 96])
    assert [frame["time_s"] for frame in written["frames"]] == pytest.approx([i / 30 for i in (1, 4, 7, 10)], abs=1e-3)
    (tmp_path / "out/annotations.xml").write_text(cvat_video({7: SQUARE}, (160, 96), 12))
    (found,) = drawn(tmp_path / "out").items()
    assert found[0] == written["frames"][2]["image"]


def test_images_of_another_size_are_not_taken_for_the_videos(tiny: Path) -> None:
    (tiny / FILE).write_text(json.dumps(record((128, 96))))
    scene = load_scene(tiny)
    assert all(frame.origin is None for frame in scene.frames)
    assert [line for line in scene.warnings if "5 images do not have the size" in line]


def test_scenes_without_the_file_are_as_they_were(tiny: Path) -> None:
    frames = load_scene(tiny).frames
    assert with_origins(tiny, frames) == (frames, [])


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"format": "other"}, "format is 'other'"),
        ({"video": 3}, "video must be the name"),
        ({"frame_count": 0}, "frame_count must be a whole number"),
        ({"frame_count": True}, "frame_count must be a whole number"),
        ({"image_size": [64]}, "image_size must be"),
        ({"image_size": [64, 1e9]}, "image_size must be"),
        ({"orientation": 9}, "orientation must be a whole number from 1 to 8"),
        ({"frames": {}}, "frames must be a list"),
        ({"frames": [3]}, "entry 0 of frames names no image"),
        ({"frames": [{"image": "a", "number": 50, "time_s": 0, "lenses": []}]}, "image a: number must be"),
        ({"frames": [{"image": "a", "number": 5, "time_s": float("nan"), "lenses": []}]}, "image a: time_s must be"),
        ({"frames": [{"image": "a", "number": 5, "time_s": 0, "lenses": [0]}]}, "image a: lenses must be"),
        ({"frames": [{"image": "a", "number": 5, "time_s": 0, "lenses": []}] * 2}, "image a occurs twice"),
        ({"lenses": [{"model": "X", "width": 64, "height": 48, "params": []}]}, "X is no camera model"),
        ({"lenses": [{"model": "PINHOLE", "width": 64, "height": 48, "params": [1]}]}, "does not have 1 params"),
        ({"lenses": [{"model": "PINHOLE", "width": 64, "height": 48, "params": ["1"]}]}, "finite numbers"),
        ({"lenses": [{"model": "PINHOLE", "width": 64, "height": 48, "params": [60, 60, 32, 24]}]}, "no distortion"),
        (
            {
                "lenses": [{"model": "SIMPLE_RADIAL", "width": 60, "height": 48, "params": [60, 32, 24, 0.1]}],
                "frames": [{"image": "a", "number": 5, "time_s": 0, "lenses": [0]}],
            },
            "a lens is for 60x48 px, not 64x48",
        ),
    ],
)
def test_damage_is_named(tiny: Path, changes: dict[str, Any], says: str) -> None:
    (tiny / FILE).write_text(json.dumps(record(**changes)))
    with pytest.raises(GtlayoutError, match=f"{FILE}.*{says}"):
        load_scene(tiny)
