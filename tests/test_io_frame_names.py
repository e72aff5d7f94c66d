"""Which frame an annotated image is: by name, by place and by number in a video."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.coco.reader import read_coco
from gtlayout.io.annotations.cvat.reader import read_cvat
from gtlayout.io.annotations.frame_names import FrameFinder, Match
from gtlayout.io.annotations.label_studio.reader import read_label_studio
from gtlayout.io.annotations.sequence import counts_evenly
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.sources import RawAnnotations, RawKeyFrame
from gtlayout.scene import Camera, FloatArray, Frame, ImageArray, VideoFrame, VideoOrigin

CAMERA = Camera(np.eye(3), np.eye(3), np.zeros(3), 64, 48)
NOWHERE = Path("no such folder")
POLYGON = '<polygon label="wall" points="0,0;60,0;60,40;0,40"/>'


def _frames(names: Sequence[str], folder: Path = NOWHERE) -> list[Frame]:
    return [Frame(name, folder / name, CAMERA) for name in names]


def _numbered(first: int, count: int, pattern: str = "frame_{:06d}.jpg") -> list[Frame]:
    return _frames([pattern.format(first + i) for i in range(count)])


def _cvat(folder: Path, frames: Sequence[int], size: int | None, **about: object) -> RawAnnotations:
    """A video task as CVAT exports it "for images"; ``about`` are fields of its ``meta/task``."""
    fields = {"mode": "interpolation", "start_frame": 0, **about}
    if size is not None:
        fields["size"] = size
    meta = "".join(f"<{key}>{value}</{key}>" for key, value in fields.items())
    images = "".join(f'<image id="{i}" name="frame_{i:06d}" width="64" height="48">{POLYGON}</image>' for i in frames)
    path = folder / "annotations.xml"
    path.write_text(f"<annotations><meta><task>{meta}</task></meta>{images}</annotations>")
    return read_cvat(folder, path)


def _tracks(folder: Path, frames: Sequence[int], **about: object) -> RawAnnotations:
    """The same "for video": tracks."""
    meta = "".join(f"<{key}>{value}</{key}>" for key, value in about.items())
    tracks = "".join(
        f'<track id="{i}" label="wall"><polygon frame="{i}" keyframe="1" outside="0" points="0,0;9,0;9,9"/></track>'
        for i in frames
    )
    path = folder / "annotations.xml"
    path.write_text(f"<annotations><meta><task>{meta}</task></meta>{tracks}</annotations>")
    return read_cvat(folder, path)


def _coco(folder: Path, names: Sequence[str], annotated: Sequence[str]) -> RawAnnotations:
    images = [{"id": i, "file_name": name, "width": 64, "height": 48} for i, name in enumerate(names)]
    drawn = {"category_id": 1, "segmentation": [[0, 0, 60, 0, 60, 40]]}
    path = folder / "coco.json"
    data = {
        "images": images,
        "categories": [{"id": 1, "name": "wall"}],
        "annotations": [{"id": i, "image_id": names.index(name), **drawn} for i, name in enumerate(annotated)],
    }
    path.write_text(json.dumps(data))
    return read_coco(folder, path)


def _by_name(names: Sequence[str]) -> RawAnnotations:
    return RawAnnotations(Path("x.json"), tuple(RawKeyFrame(name, (), None) for name in names))


def _find(raw: RawAnnotations, frames: Sequence[Frame], absent: Sequence[str] = ()) -> tuple[list[Any], str]:
    """What each key frame is (index, or -1 - index on the video, or why not), and the warning."""
    find = FrameFinder(raw, frames, absent)
    found = [find(key_frame) for key_frame in raw.key_frames]
    indices = [(-1 - m.index if m.on_video else m.index) if isinstance(m, Match) else m for m in found]
    assert len(find.warnings) <= 1
    return indices, "".join(find.warnings)


def test_by_path_name_and_stem() -> None:
    frames = _frames(["a/1.jpg", "b/1.jpg", "b/2.jpg", "frame_000030.png"])
    raw = _by_name(
        ["a/1.jpg", "images/a/1.jpg", "b\\1.jpg", "x/b/2.jpg", "2", "frame_000030", "1.jpg", "z/lost.jpg", "77.jpg"]
    )
    assert _find(raw, frames, ("c/lost.jpg",)) == (
        [
            0, 0, 1, 2, 2, 3,
            "may be a/1.jpg or b/1.jpg: write its folder as it is there",
            "has no image file",
            "has no camera",
        ],
        "",
    )  # fmt: skip


def test_names_that_leave_a_doubt_are_said() -> None:
    frames = _frames(["a/IMG_0001.jpg", "a/IMG_0002.jpg", "b/IMG_0003.jpg"])
    assert _find(_by_name(["c/IMG_0003.jpg", "a/IMG_0001.jpg", "2"]), frames) == (
        [2, 0, 1],
        "1 images are matched by their numbers alone, first 2 is a/IMG_0002.jpg; 1 images are matched although they "
        "lie in other folders, first c/IMG_0003.jpg is b/IMG_0003.jpg",
    )
    # One folder tells nothing, and neither does one that a name lacks.
    assert _find(_by_name(["c/IMG_0001.jpg"]), frames[:2]) == ([0], "")
    assert _find(_by_name(["IMG_0001.jpg"]), frames) == ([0], "")
    two_of_a_number = _frames(["front_12.jpg", "back_12.jpg"])
    assert _find(_by_name(["12"]), two_of_a_number) == (["has no camera"], "")


def test_an_image_without_camera_is_not_the_next_best_frame(tmp_path: Path) -> None:
    for name in ("0001.JPG", "0002.jpg", "0003.jpg", "0003.txt"):
        (tmp_path / name).touch()
    frames = _frames(["0001.JPG", "0002.jpg"], tmp_path)
    raw = _by_name(["cam1/0003.jpg", "3", "0001.jpg", "0003.txt"])
    assert _find(raw, frames) == (["has no camera", "has no camera", 0, "has no camera"], "")
    frames = [Frame(f"in/{frame.name}", frame.image_path, CAMERA) for frame in frames]
    assert _find(_by_name(["in/0003.jpg"]), frames)[0] == ["has no camera"]


# --- sequences: a task over a video ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "names",
    [[f"frame_{i:06d}.jpg" for i in range(1, 17)], [f"img{i}.png" for i in range(101, 117)]],
)
def test_by_place_where_there_are_as_many_images(tmp_path: Path, names: list[str]) -> None:
    found, said = _find(_cvat(tmp_path, [0, 8, 15], 16), _frames(names))
    assert found == [0, 8, 15]
    other = (
        ""
        if "img" in names[0]
        else (
            "images are matched by their place, because there are 16 images there and here; so frame_000008 is "
            "frame_000009.jpg, although it is called like frame_000008.jpg"
        )
    )
    assert said == other


def test_place_and_name_that_agree_need_no_word(tmp_path: Path) -> None:
    assert _find(_cvat(tmp_path, [0, 8, 15], 16), _numbered(0, 16)) == ([0, 8, 15], "")


@pytest.mark.parametrize("pattern", ["frame_{:06d}.jpg", "{}.jpg", "IMG_{:04d}.jpg"])
def test_by_number_where_counts_differ(tmp_path: Path, pattern: str) -> None:
    found, said = _find(_cvat(tmp_path, [0, 8, 15, 16], 240), _numbered(1, 16, pattern))
    none = "has a number that no image of the scene has"
    assert found == [none, 7, 14, 15]
    assert said == (
        "its images are numbers of 240 frames, the scene has 16 images: they are matched by the numbers in the names, "
        f"frame_000008 is {pattern.format(8)}; those of the scene begin with 1. Where numbers do not mean the same "
        "there and here, drawings are on wrong frames: look at them, or annotate the scene's own images"
    )


def test_names_without_endings_are_numbers_all_the_same(tmp_path: Path) -> None:
    found, said = _find(_cvat(tmp_path, [3], 240), _numbered(0, 5, "frame_{:06d}"))
    assert found == [3]
    assert "numbers of 240 frames, the scene has 5 images" in said


def test_a_file_that_does_not_say_how_many_frames_there_were(tmp_path: Path) -> None:
    found, said = _find(_cvat(tmp_path, [3], None), _numbered(0, 5))
    assert found == [3]
    assert said.startswith("its images are numbers of an unknown number of frames, the scene has 5 images")


def test_every_tenth_frame(tmp_path: Path) -> None:
    step = {"start_frame": 100, "stop_frame": 330, "frame_filter": "step=10"}
    counted = _cvat(tmp_path, [100, 110, 330], 24, **step)
    assert _find(counted, _numbered(1, 24, "out{:04d}.png"))[0] == [0, 1, 23]
    assert _find(counted, _frames([f"{i}.png" for i in range(100, 340, 10)])) == ([0, 1, 23], "")
    # The whole video was annotated, each tenth frame extracted and called by its number: counts cannot say so.
    found, said = _find(_cvat(tmp_path, [100, 110], 340), _frames([f"{i}.png" for i in range(100, 340, 10)]))
    assert found == [0, 1]
    assert "numbers of 340 frames, the scene has 24 images" in said


@pytest.mark.parametrize("on_disk", [6, 5])
def test_places_count_images_without_camera(tmp_path: Path, on_disk: int) -> None:
    for i in range(1, on_disk + 1):
        (tmp_path / f"{i}.jpg").touch()
    frames = _frames([f"{i}.jpg" for i in (1, 2, 4, 5)], tmp_path)
    find = _find(_cvat(tmp_path, [0, 2, 3, 5], 6), frames, [] if on_disk == 6 else ["6.jpg"])
    gone = "(6.jpg) has no camera" if on_disk == 6 else "(6.jpg) has no image file"
    assert find[0] == [0, "(3.jpg) has no camera", 2, gone]
    # Cameras alone are as many as the task has images.
    assert _find(_cvat(tmp_path, [2], 4), frames)[0] == [2]


def test_places_are_those_of_the_files_on_disk_first(tmp_path: Path) -> None:
    for i in range(1, 7):
        (tmp_path / f"{i}.jpg").touch()
    frames = [Frame(f"in/{i}.jpg", tmp_path / f"{i}.jpg", CAMERA) for i in (1, 2, 4, 5)]
    raw = _cvat(tmp_path, [2, 3], 6)
    assert _find(raw, frames, ["in/0.jpg"])[0] == ["(in/3.jpg) has no camera", 2]
    # With what cameras know beside them there are seven.
    raw = _cvat(tmp_path, [2, 3], 7)
    assert _find(raw, frames, ["in/0.jpg"])[0] == [1, "(in/3.jpg) has no camera"]


def test_numbers_beyond_the_sequence(tmp_path: Path) -> None:
    raw = _cvat(tmp_path, [4, 5], 4, start_frame=2)
    assert _find(raw, _numbered(1, 4))[0] == [2, 3]
    raw = _cvat(tmp_path, [1, 9], 4, start_frame=2)
    assert _find(raw, _numbered(1, 4))[0] == ["is none of the 4 images that its file counts"] * 2


def test_images_known_by_place_alone(tmp_path: Path) -> None:
    about = {"mode": "annotation", "size": 12}
    in_order, shuffled = _numbered(0, 12, "{:03d}.jpg"), _numbered(1, 12, "{}.jpg")
    assert _find(_tracks(tmp_path, [2, 11], **about), in_order) == ([2, 11], "")
    # CVAT sorts what is uploaded by letters: 1, 10, 11, 12, 2 …
    found, said = _find(_tracks(tmp_path, [0, 1, 4], **about), shuffled)
    assert found == [0, 9, 1]
    assert said == (
        "its images are numbers without names: they are taken to be sorted as CVAT does, by letters (1.jpg, 10.jpg …); "
        "export as 'CVAT for images 1.1', which names them"
    )
    # Their number is no name.
    found, said = _find(_tracks(tmp_path, [2], **about), in_order[:11])
    assert found == [
        "is known by its place among 12 images only, the scene has 11: export as 'CVAT for images 1.1', which names "
        "them"
    ]
    assert said == ""


def test_a_project_has_no_count(tmp_path: Path) -> None:
    text = "<meta><project><tasks><task><size>5</size></task><task><size>5</size></task></tasks></project></meta>"
    path = tmp_path / "annotations.xml"
    path.write_text(
        f'<annotations>{text}<image name="frame_000002" width="64" height="48">{POLYGON}</image></annotations>'
    )
    found, said = _find(read_cvat(tmp_path, path), _numbered(0, 5))
    assert found == [2]
    assert "an unknown number of frames" in said


# --- sequences: lists of numbered names ------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["PNG", "jpg"])
@pytest.mark.parametrize("pattern", ["frame_{:06d}", "{}"])
def test_a_list_of_numbers_goes_by_place(tmp_path: Path, ending: str, pattern: str) -> None:
    names = [f"images/{pattern.format(i)}.{ending}" for i in range(16)]
    found, said = _find(_coco(tmp_path, names, [names[0], names[8], names[15]]), _numbered(1, 16))
    assert found == [0, 8, 15]
    assert said.startswith("images are matched by their place, because there are 16 images there and here")


def test_the_same_list_in_cvats_file(tmp_path: Path) -> None:
    images = "".join(
        f'<image name="{i}.jpg" width="64" height="48">{POLYGON if i == 3 else ""}</image>' for i in range(5)
    )
    path = tmp_path / "annotations.xml"
    path.write_text(f"<annotations><meta/>{images}</annotations>")
    assert _find(read_cvat(tmp_path, path), _numbered(1, 5, "{}.jpg"))[0] == [3]


@pytest.mark.parametrize(
    ("listed", "there"),
    [
        (range(16), range(16)),
        (range(16), range(2, 12)),
        (range(8), range(16)),
        (range(0, 16, 2), range(16)),
        ([0, 1, 3, 4], range(4)),
        (range(4), [0, 2, 3, 5]),
    ],
)
def test_names_that_are_there_are_names(tmp_path: Path, listed: Sequence[int], there: Sequence[int]) -> None:
    names, there = [f"{i:03d}.jpg" for i in listed], list(there)
    annotated = [i for i in (2, 3, 4) if i in listed and i in there]
    raw = _coco(tmp_path, names, [f"{i:03d}.jpg" for i in annotated])
    assert _find(raw, _frames([f"{i:03d}.jpg" for i in there])) == ([there.index(i) for i in annotated], "")


def test_a_list_that_is_not_complete_is_no_sequence(tmp_path: Path) -> None:
    images = "".join(f'<image name="{i}.jpg" width="64" height="48">{POLYGON}</image>' for i in range(0, 40, 10))
    path = tmp_path / "annotations.xml"
    path.write_text(f"<annotations><meta><task><size>40</size></task></meta>{images}</annotations>")
    frames = _frames([f"{i}.jpg" for i in range(10, 50, 10)])
    assert _find(read_cvat(tmp_path, path), frames) == (["has no camera", 0, 1, 2], "")


def test_the_same_list_in_label_studios_file(tmp_path: Path) -> None:
    region = {
        "type": "polygonlabels",
        "original_width": 64,
        "original_height": 48,
        "value": {"points": [[0, 0], [50, 0], [50, 50]], "polygonlabels": ["wall"]},
    }
    tasks = [
        {
            "data": {"image": f"/data/upload/3/{i:08x}-{i:04d}.jpg"},
            "annotations": [{"result": [region]}] if i == 3 else [],
        }
        for i in range(5)
    ]
    path = tmp_path / "export.json"
    path.write_text(json.dumps(tasks))
    raw = read_label_studio(tmp_path, path)
    assert raw.listed == tuple(task["data"]["image"] for task in tasks)  # type: ignore[index]
    found, said = _find(raw, _numbered(1, 5, "{:04d}.jpg"))
    assert found == [3]
    assert said == (
        "images are matched by their place, because there are 5 images there and here; so "
        "/data/upload/3/00000003-0003.jpg is 0004.jpg, although it is called like 0003.jpg"
    )
    assert _find(raw, _numbered(0, 4, "{:04d}.jpg")) == ([3], "")


@pytest.mark.parametrize(
    ("numbers", "evenly"),
    [([0, 1, 2], True), ([30, 10, 20], True), ([0, 1, 3], False), ([3, 3], False), ([3], False), ([], False)],
)
def test_counting_evenly(numbers: list[int], *, evenly: bool) -> None:
    assert counts_evenly(numbers) == evenly


def test_a_list_with_tracks_or_other_names_is_no_sequence(tmp_path: Path) -> None:
    names = [f"{i}.jpg" for i in range(5)]
    frames = _numbered(1, 5, "{}.jpg")
    assert _find(_coco(tmp_path, [*names, "cover.jpg"], names[3:4]), frames) == ([2], "")
    images = "".join(f'<image name="{name}" width="64" height="48">{POLYGON}</image>' for name in names)
    track = '<track id="0" label="wall"><polygon frame="2" keyframe="1" outside="0" points="0,0;9,0;9,9"/></track>'
    path = tmp_path / "annotations.xml"
    path.write_text(f"<annotations><meta/>{images}{track}</annotations>")
    assert _find(read_cvat(tmp_path, path), frames)[0] == ["has no camera", 0, 1, 2, 3, 1]


def test_a_list_of_other_names_is_no_sequence(tmp_path: Path) -> None:
    names = [f"clip_{i}.jpg" for i in range(5)]
    assert _find(_coco(tmp_path, names, names[3:4]), _numbered(1, 5, "clip_{}.jpg")) == ([2], "")


def test_a_list_with_other_endings_is_doubted_where_counts_differ(tmp_path: Path) -> None:
    names = [f"frame_{i:06d}.PNG" for i in range(16)]
    found, said = _find(_coco(tmp_path, names, names[3:4]), _numbered(1, 5))
    assert found == [2]
    assert "numbers of 16 frames, the scene has 5 images" in said


# --- frames that are known to come from a video ----------------------------------------------------------------------


def _of_video(numbers: Sequence[int], count: int = 240, name: str = "clip.mp4") -> list[Frame]:
    names = [f"{round(n / 30 * 1e6):012d}.jpg" for n in numbers]
    return [
        replace(frame, origin=VideoOrigin(name, n, n / 30, count))
        for frame, n in zip(_frames(names), numbers, strict=True)
    ]


def test_frames_are_found_by_their_number_in_the_video(tmp_path: Path) -> None:
    found, said = _find(_cvat(tmp_path, [0, 12, 17, 21], 240), _of_video([0, 10, 12, 21]))
    assert found == [
        -1,
        -3,
        "is frame 17 of clip.mp4, which is no frame of the scene; the nearest is frame 21, 000000700000.jpg",
        -4,
    ]
    assert said == ""
    found, _ = _find(_cvat(tmp_path, [11], 240), _of_video([0, 10, 12, 21]))
    assert found == [
        "is frame 11 of clip.mp4, which is no frame of the scene; the nearest is frame 10, 000000333333.jpg"
    ]


def test_a_task_over_a_part_of_the_video(tmp_path: Path) -> None:
    for about in ({"start_frame": 10}, {"frame_filter": "step=2"}):
        assert _find(_cvat(tmp_path, [10, 12], 4, **about), _of_video([0, 10, 12, 21])) == ([-2, -3], "")
    path = tmp_path / "annotations.xml"
    _cvat(tmp_path, [10, 12], 4)
    path.write_text(path.read_text().replace("task>", "job>"))
    assert _find(read_cvat(tmp_path, path), _of_video([0, 10, 12, 21])) == ([-2, -3], "")


def test_a_video_of_another_length(tmp_path: Path) -> None:
    found, said = _find(_cvat(tmp_path, [10], 239), _of_video([0, 10, 12]))
    assert found == [-2]
    assert said == (
        "the video that was annotated has 239 frames, clip.mp4 has 240: images are matched by their number in it"
    )
    found, said = _find(_tracks(tmp_path, [10]), _of_video([0, 10, 12]))
    assert found == [-2]
    assert said.startswith("the video that was annotated has an unknown number of frames, clip.mp4 has 240")


def test_other_images_than_the_videos(tmp_path: Path) -> None:
    frames = _of_video([0, 10, 12])
    # A video made of the extracted images; their list; an image task.
    assert _find(_cvat(tmp_path, [2], 3), frames) == ([2], "")
    assert _find(_tracks(tmp_path, [2], size=3, mode="annotation"), frames) == ([2], "")
    (alone,), _ = _find(_tracks(tmp_path, [2], size=4, mode="annotation"), frames)
    assert alone.startswith("is known by its place among 4 images only")
    assert _find(_by_name([frames[1].name, frames[2].name.removesuffix(".jpg")]), frames) == ([1, 2], "")
    names = [f"frame_{i:06d}.PNG" for i in range(240)]
    assert _find(_coco(tmp_path, names, names[10:11]), frames) == ([-2], "")
    found, said = _find(_coco(tmp_path, names[:100], names[10:11]), frames)
    assert found == [-2]
    assert said.startswith("the video that was annotated has 100 frames, clip.mp4 has 240")
    # Numbers alone may be names of anything.
    names = [f"{i}.jpg" for i in range(240)]
    assert _find(_coco(tmp_path, names, names[10:11]), frames)[0] == ["has a number that no image of the scene has"]
    # Numbers that the video does not have, or two videos, are none of its.
    found, said = _find(_cvat(tmp_path, [10, 240], 241), frames)
    assert found == ["has a number that no image of the scene has"] * 2
    assert "numbers of 241 frames, the scene has 3 images" in said
    two = [*frames, *_of_video([10], name="other.mp4")]
    assert _find(_cvat(tmp_path, [10], 240), two)[0] == ["has a number that no image of the scene has"]


def test_a_number_by_hand_is_the_videos(tmp_path: Path) -> None:
    frames = _of_video([0, 10, 12])
    found, said = _find(_by_name(["frame_10", "11", "999999"]), frames)
    assert found[0] == -2
    assert found[1].startswith("is frame 11 of clip.mp4, which is no frame of the scene")
    assert found[2] == "has no camera"
    assert said == "1 images are matched by their numbers alone, first frame_10 is 000000333333.jpg"


@dataclass
class _Video:
    path: Path
    times_s: FloatArray
    width: int = 64
    height: int = 48

    def frame(self, index: int) -> ImageArray:
        raise AssertionError(f"frame {index} is decoded, and only numbers are to be compared")


def test_frames_that_are_read_from_a_video(tmp_path: Path) -> None:
    video = _Video(Path("clip.mp4"), np.arange(30) / 30)
    frames = [replace(frame, video=VideoFrame(video, 20 + i)) for i, frame in enumerate(_numbered(20, 4, "{}00.jpg"))]
    find = FrameFinder(_cvat(tmp_path, [21], 30), frames, ())
    assert find(RawKeyFrame("frame_000021", (), None, 21, 21)) == Match(1, on_video=False)
    assert _find(_cvat(tmp_path, [20, 23, 3], 30), frames)[0] == [
        0,
        3,
        "is frame 3 of clip.mp4, which is no frame of the scene; the nearest is frame 20, 2000.jpg",
    ]


# --- as a user meets it ----------------------------------------------------------------------------------------------


def test_check_says_how_a_video_task_was_matched(tiny: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tiny / "annotations.json").unlink()
    _cvat(tiny, [1, 3], 90)
    main(["check", str(tiny)])
    out = " ".join("".join(capsys.readouterr()).split())
    assert "annotations.xml: its images are numbers of 90 frames, the scene has 5 images" in out
    scene = load_scene(tiny)
    assert [key_frame.frame for key_frame in scene.key_frames] == [1, 3]
    assert sum("numbers of 90 frames" in line for line in scene.warnings) == 1


def test_reasons_of_the_reader_are_said_when_nothing_is_left(tiny: Path) -> None:
    (tiny / "annotations.json").unlink()
    (tiny / "a.xml").write_text(
        '<annotations><image name="001.png" width="64" height="48"><points label="wall" points="1,1"/>'
        '<tag label="wall"/></image></annotations>'
    )
    with pytest.raises(GtlayoutError, match=r"no usable element in any frame \(points skipped: .*; tag skipped: "):
        load_scene(tiny)
    (tiny / "a.xml").write_text('<annotations><image name="001.png" width="64" height="48"/></annotations>')
    with pytest.raises(GtlayoutError, match=r"no usable element in any frame \(nothing is drawn in it\)"):
        load_scene(tiny)
