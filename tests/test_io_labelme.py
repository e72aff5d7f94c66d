"""LabelMe: files in its documented format, masks, groups, what is dropped, round trip."""

from __future__ import annotations

import base64
import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import shapely
from scene_checks import assert_same_drawings
from shapely import Polygon

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.labelme import READER, read_labelme, write_labelme
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.sources import RawShape
from gtlayout.scene import Frame, KeyFrame

SQUARE = [[10, 20], [30, 20], [30, 40], [10, 40]]
BOX = shapely.box(10, 20, 30, 40)


def _png(image: Any) -> str:
    ok, png = cv2.imencode(".png", image)
    assert ok
    return base64.b64encode(png.tobytes()).decode()


def _shape(points: Any = SQUARE, label: Any = "wall", **fields: Any) -> dict[str, Any]:
    common: dict[str, Any] = {"group_id": None, "description": "", "shape_type": "polygon", "flags": {}, "mask": None}
    return {"label": label, "points": points, **common, **fields}


def _write(folder: Path, *shapes: Any, image: Any = "001.png", **fields: Any) -> Path:
    """As LabelMe 5 writes it."""
    data = {
        "version": "5.5.0",
        "flags": {},
        "shapes": shapes,
        "imagePath": image,
        "imageData": None,
        "imageHeight": 48,
        "imageWidth": 64,
        **fields,
    }
    path = folder / f"{Path(str(image)).stem}.json"
    path.write_text(json.dumps(data, indent=2))
    return path


def _read(folder: Path, *shapes: Any) -> tuple[RawShape, ...]:
    _write(folder, *shapes)
    read = read_labelme(folder, folder)
    assert read.warnings == ()
    return read.key_frames[0].shapes


def _region(rings: Any) -> Any:
    return shapely.union_all([Polygon(ring) for ring in rings])


def test_a_square_is_the_same_however_it_is_drawn(tmp_path: Path) -> None:
    pixels = np.ones((20, 20), dtype=np.uint8)  # columns 10 to 29, rows 20 to 39
    shapes = [
        _shape(),
        _shape([[30, 40], [10, 20]], shape_type="rectangle"),
        _shape(SQUARE, shape_type="rotation"),
        _shape([[10, 20], [29, 39]], shape_type="mask", mask=_png(pixels)),
        _shape([[10, 20], [30, 40]], shape_type="mask", mask=_png(pixels * 255)),
    ]
    shapes += [_shape(shape_type=None), _shape(shape_type="quadrilateral")]
    del shapes[0]["shape_type"]  # version 3 had none
    for shape in _read(tmp_path, *shapes):
        assert _region(shape.polygons).equals(BOX)


def test_holes_of_masks_survive(tmp_path: Path) -> None:
    pixels = np.ones((20, 30), dtype=np.uint8)
    pixels[5:10, 5:15] = 0
    (shape,) = _read(tmp_path, _shape([[4, 2], [33, 21]], shape_type="mask", mask=_png(pixels)))
    assert _region(shape.polygons).equals(shapely.box(4, 2, 34, 22) - shapely.box(9, 7, 19, 12))


def test_groups_lines_and_descriptions(tmp_path: Path) -> None:
    wall, visible, edge, line = _read(
        tmp_path,
        _shape(group_id=3, description="id=west"),
        _shape(label="visible", group_id=3, description="by the door"),
        _shape([[1, 2], [3.5, 4], [5, 6]], "occlusion_edge", shape_type="linestrip"),
        _shape([[1, 2], [3, 4]], "occlusion_edge", shape_type="line"),
    )
    assert (wall.group, wall.id, visible.group, visible.id) == ("3", "west", "3", None)
    assert [each.tolist() for each in edge.lines + line.lines] == [[[1, 2], [3.5, 4], [5, 6]], [[1, 2], [3, 4]]]


@pytest.mark.parametrize(
    ("said", "image"),
    [
        ("001.png", "001.png"),
        ("..\\images\\001.png", "..\\images\\001.png"),
        ("/etc/001.png", "/etc/001.png"),
        (None, "None"),
    ],
)
def test_images_are_names_only(tmp_path: Path, said: Any, image: str) -> None:
    _write(tmp_path, _shape(), image=said, imageData="not looked at", imageWidth=None)
    (key_frame,) = read_labelme(tmp_path, tmp_path).key_frames
    assert (key_frame.image, key_frame.image_size) == (image, None)


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (
            _shape([[5, 5], [9, 9]], shape_type="circle"),
            "circle skipped: it is no polygon, rectangle, mask, line or linestrip",
        ),
        (_shape([[5, 5]], shape_type="point"), "point skipped: it is no polygon"),
        (_shape(shape_type={1: 2}), "shape skipped: it is no polygon"),
        (_shape(label=None), "it has no label"),
        (_shape(label="x" * 5000), "it has no label"),
        ("shape", "it has no label"),
        (_shape(None), "points are no pairs"),
        (_shape([[1, 2, 3]]), "points are no pairs"),
        (_shape([[1, None]]), "points are no pairs"),
        (_shape([[1, 10**400]]), "points are no pairs"),
        (_shape([[0, 0], [1, 1]], shape_type="mask"), "its mask lacks its two points or its pixels"),
        (_shape([[0, 0], [1, 1]], shape_type="mask", mask="ä"), "its mask is no base64"),
        (_shape([[0, 0], [1, 1]], shape_type="mask", mask="abcd"), "its mask is no PNG image"),
        (
            _shape([[0, 0], [1, 1]], shape_type="mask", mask=_png(np.ones((3, 3), np.uint8))),
            "another size than its two",
        ),
        (_shape([[0, 0], [1, 1]], shape_type="mask", mask=_png(np.ones((2, 2, 3), np.uint8))), "8-bit grey"),
    ],
)
def test_what_is_dropped(tmp_path: Path, bad: Any, says: str) -> None:
    _write(tmp_path, bad, _shape(), bad)
    read = read_labelme(tmp_path, tmp_path)
    assert len(read.key_frames[0].shapes) == 1
    (warning,) = read.warnings
    assert says in warning
    assert "(2, first in 001.json)" in warning


def test_broken_files(tmp_path: Path) -> None:
    good, cut = _write(tmp_path, _shape(), image="1.png"), _write(tmp_path, _shape(), image="2.png")
    cut.write_text(cut.read_text()[:-20])
    _write(tmp_path, image="3.png", shapes={})
    _write(tmp_path, image="4.png")  # nothing drawn yet
    read = read_labelme(tmp_path, tmp_path)
    assert [key_frame.image for key_frame in read.key_frames] == ["1.png"]
    assert [w.split(str(tmp_path))[1][:22] for w in read.warnings] == [
        "/2.json is not valid J",
        "/3.json: shapes must b",
    ]
    good.unlink()
    (tmp_path / "4.json").unlink()
    with pytest.raises(GtlayoutError, match=r"2\.json is not valid JSON"):
        read_labelme(tmp_path, tmp_path)


def test_the_folder_is_found(tiny: Path) -> None:
    (tiny / "annotations.json").unlink()
    wall = [[0, 0], [64, 0], [64, 48], [0, 48]]
    for i in (1, 3):
        _write(
            tiny / "images", _shape(wall, "Wall", group_id=0), _shape(label="Visible", group_id=0), image=f"{i:03d}.png"
        )
    assert READER.detect(tiny) == [tiny / "images"]
    scene = load_scene(tiny)
    assert scene.warnings == ()
    assert [(k.frame, k.elements[0].amodal.area, k.elements[0].visible.area) for k in scene.key_frames] == [
        (1, 64 * 48, 400),
        (3, 64 * 48, 400),
    ]


def test_round_trip_of_a_room(room: Path, tmp_path: Path) -> None:
    scene = load_scene(room)
    copy = tmp_path / "room"
    shutil.copytree(room, copy)
    (copy / "annotations.json").unlink()
    write_labelme(copy / "annotations", scene.frames, scene.key_frames)
    again = load_scene(copy)
    assert again.warnings == scene.warnings
    assert_same_drawings(scene, again)
    for before, after in zip(scene.key_frames, again.key_frames, strict=True):
        for line, same in zip(before.occlusion_edges, after.occlusion_edges, strict=True):
            np.testing.assert_allclose(same, line)


def test_two_images_of_one_name_cannot_be_written(tiny: Path, tmp_path: Path) -> None:
    camera = load_scene(tiny).frames[0].camera
    frames = [Frame("a/1.jpg", Path(), camera), Frame("b/1.png", Path(), camera)]
    with pytest.raises(GtlayoutError, match="two images of that name"):
        write_labelme(tmp_path / "out", frames, [KeyFrame(0, ()), KeyFrame(1, ())])
    assert not (tmp_path / "out").exists()
