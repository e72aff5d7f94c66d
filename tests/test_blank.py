"""Areas that are left blank on purpose: every format can say so, and they are neither elements nor key frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import shapely
from label_studio_writer import write_label_studio
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.coco.reader import read_coco, write_coco
from gtlayout.io.annotations.cvat.reader import read_cvat
from gtlayout.io.annotations.cvat.writer import write_cvat
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.label_studio.reader import read_label_studio
from gtlayout.io.annotations.labelme import read_labelme, write_labelme
from gtlayout.io.annotations.native import read_annotations, write_annotations
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.sources import RawAnnotations
from gtlayout.scene import Element, Frame, KeyFrame

WALL = Element("w", "wall", MultiPolygon([shapely.box(0, 0, 30, 48)]), MultiPolygon())
BLANK = MultiPolygon([shapely.box(30, 0, 64, 48) - shapely.box(40, 10, 50, 20)])

Write = Callable[[Path, Sequence[Frame], Sequence[KeyFrame]], None]
Read = Callable[[Path, Path], RawAnnotations]


@pytest.mark.parametrize(
    ("write", "read", "name"),
    [
        (write_annotations, read_annotations, "annotations.json"),
        (write_cvat, read_cvat, "annotations.xml"),
        (write_coco, read_coco, "coco.json"),
        (write_labelme, read_labelme, "labelme"),
        (write_label_studio, read_label_studio, "label_studio.json"),
    ],
)
def test_what_is_left_blank_is_read_back(write: Write, read: Read, name: str, tiny: Path, tmp_path: Path) -> None:
    frames = load_scene(tiny).frames
    path = tmp_path / "out" / name
    write(path, frames, [KeyFrame(2, (WALL,), blank=BLANK)])
    (key_frame,), warnings = build_key_frames(read(tmp_path, path), frames, (), {})
    assert [line for line in warnings if "blank" in line] == []
    assert [element.label for element in key_frame.elements] == ["wall"]
    assert key_frame.blank.symmetric_difference(BLANK).area < 0.1


def test_an_own_label_may_mean_blank(tiny: Path) -> None:
    write_json_atomic(tiny / "labels.json", {"nothing": "blank"})
    data = read_json(tiny / "annotations.json")
    nothing = {"id": "n", "label": "nothing", "polygons": [[[0, 0], [9, 0], [9, 9], [0, 9]]]}
    data["frames"][0]["elements"].append(nothing)
    write_json_atomic(tiny / "annotations.json", data)
    scene = load_scene(tiny)
    assert [key_frame.blank.area for key_frame in scene.key_frames] == [81.0, 0.0]


def test_an_image_that_is_only_blank_is_no_key_frame(tiny: Path) -> None:
    frames = load_scene(tiny).frames
    write_annotations(tiny / "annotations.json", frames, [KeyFrame(2, (), blank=BLANK)])
    with pytest.raises(GtlayoutError, match="no usable element in any frame"):
        load_scene(tiny)


def test_few_files_have_the_key(tiny: Path) -> None:
    scene = load_scene(tiny)
    write_annotations(tiny / "annotations.json", scene.frames, scene.key_frames)
    assert all("blank" not in frame for frame in read_json(tiny / "annotations.json")["frames"])
