"""CVAT's XML: written by datumaro and by hand after CVAT's documentation, read; written by us, read by datumaro."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon
from tools_env import run_tool

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.cvat.reader import PROPOSED, read_cvat
from gtlayout.io.annotations.cvat.writer import write_cvat
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.sources import RawAnnotations, RawShape
from gtlayout.scene import LABELS, Camera, Element, Frame, KeyFrame

SIZE = (64, 48)
TURNED = [[30.0, 20.0], [38.0, 26.0], [35.0, 30.0], [27.0, 24.0]]
"""A rectangle of 10 x 5 px, its upper edge falling 3 in 4."""


def _drawn(kind: str, label: str, points: Any, **more: Any) -> dict[str, Any]:
    return {"type": kind, "label": label, "points": points, **more}


DRAWING: list[dict[str, Any]] = [
    {
        "image": "001.png",
        "size": SIZE,
        "shapes": [
            _drawn("polygon", "Wall", [0.25, 0, 40, 0, 40.5, 30.75], z_order=2, group=7, attributes={"id": "w"}),
            _drawn("polygon", "visible", [10, 5, 20, 5, 20, 15, 10, 15], attributes={"element": "f"}),
            _drawn("polyline", "occlusion_edge", [40, 0, 40.12, 30], attributes={}),
            {
                "type": "mask",
                "label": "floor",
                "fill": [[10, 5, 20, 15]],
                "clear": [],
                "attributes": {"id": "f"},
                "z_order": 3,
            },
            {"type": "mask", "label": "door", "fill": [[3, 4, 12, 14]], "clear": [[5, 6, 9, 9]]},
            _drawn("box", "window", [1, 2, 7.5, 9]),
            _drawn("turned", "slanted", TURNED),
            _drawn("points", "wall", [3, 4]),
        ],
    },
    {"image": "002.png", "size": SIZE, "shapes": []},
    {"image": "003.png", "size": SIZE, "shapes": [_drawn("polygon", "Wall", [0, 0, 9, 0, 9, 9])]},
]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What datumaro made of the drawing; as tracks, too: of two walls and a line, one interpolated, one gone."""
    folder = tmp_path_factory.mktemp("cvat")
    for kind, drawing in (("drawn", DRAWING), ("tracked", _tracked())):
        (folder / f"{kind}.json").write_text(json.dumps(drawing))
    run_tool("make_cvat.py", str(folder / "drawn.json"), str(folder / "drawn"))
    run_tool("make_cvat.py", str(folder / "tracked.json"), str(folder / "tracked"))
    return folder


def _tracked() -> list[dict[str, Any]]:
    def wall(track: int, x: float, **said: bool) -> dict[str, Any]:
        return _drawn("polygon", "wall", [x, 0, x + 9, 0, x, 9], attributes={"track_id": track, **said}, z_order=track)

    line = _drawn("polyline", "occlusion_edge", [5, 5, 6, 20], attributes={"track_id": 5, "keyframe": True})
    return [
        {"image": "0.png", "size": SIZE, "shapes": [wall(1, 10, keyframe=True), wall(2, 20)]},
        {"image": "1.png", "size": SIZE, "shapes": [wall(1, 11), wall(2, 21)]},
        {"image": "2.png", "size": SIZE, "shapes": [wall(1, 12, keyframe=True, outside=True), wall(2, 22)]},
        {"image": "3.png", "size": SIZE, "shapes": [wall(2, 23, keyframe=True), line]},
    ]


def _same(rings: tuple[np.ndarray, ...], region: Polygon) -> bool:
    return bool(shapely.union_all([Polygon(ring) for ring in rings]).symmetric_difference(region).area < 1e-9)


def test_images_made_by_datumaro(made: Path) -> None:
    raw = read_cvat(made, made / "drawn/images/default.xml")
    assert [(k.image, k.image_size, k.number) for k in raw.key_frames] == [
        ("001.png", SIZE, None),
        ("003.png", SIZE, None),
    ]
    assert raw.sequence_length == 3
    assert raw.warnings == (
        "default.xml: points skipped: it is no polygon, polyline, box or mask (1, first in 001.png)",
    )
    wall, visible, line, floor, door, window, slanted = raw.key_frames[0].shapes
    assert [s.label for s in raw.key_frames[0].shapes] == [
        "Wall", "visible", "occlusion_edge", "floor", "door", "window", "slanted",
    ]  # fmt: skip
    assert (wall.id, wall.element, wall.group, wall.z_order) == ("w", None, "7", 2)
    assert (visible.id, visible.element, visible.group, visible.z_order) == (None, "f", None, 0)
    assert wall.polygons[0].tolist() == [[0.25, 0], [40, 0], [40.5, 30.75]]
    assert line.lines[0].tolist() == [[40, 0], [40.12, 30]]
    assert line.polygons == ()
    assert floor.id == "f"
    assert _same(floor.polygons, shapely.box(10, 5, 20, 15))
    assert _same(door.polygons, shapely.box(3, 4, 12, 14) - shapely.box(5, 6, 9, 9))
    assert _same(window.polygons, shapely.box(1, 2, 7.5, 9))
    assert np.allclose(slanted.polygons[0], TURNED, atol=0.01)


def test_polygon_and_mask_of_one_square_are_the_same(made: Path) -> None:
    raw = read_cvat(made, made / "drawn/images/default.xml")
    (key_frame,), _ = build_key_frames(raw, [_frame("001.png")], (), {})
    (floor,) = [element for element in key_frame.elements if element.label == "floor"]
    assert shapely.equals(floor.visible, shapely.box(10, 5, 20, 15))
    assert shapely.equals(floor.amodal, floor.visible)


def test_tracks_made_by_datumaro(made: Path) -> None:
    raw = read_cvat(made, made / "tracked/tracks/default.xml")
    assert [(k.image, k.image_size, k.number) for k in raw.key_frames] == [
        ("frame_000000", SIZE, 0),
        ("frame_000003", SIZE, 3),
    ]
    assert raw.sequence_length == 4
    assert [line.removeprefix("default.xml: ") for line in raw.warnings] == [
        "frame left out: all its shapes were interpolated by CVAT, none drawn (2, first in frame_000001)",
        "shape in a key frame was interpolated by CVAT, not drawn: check it (1, first in frame_000000)",
    ]
    drawn = [[(s.id, s.label, s.z_order) for s in k.shapes] for k in raw.key_frames]
    assert drawn == [
        [("track_1", "wall", 1), ("track_2", "wall", 2)],
        [("track_2", "wall", 2), ("track_5", "occlusion_edge", 0)],
    ]
    assert np.array_equal(raw.key_frames[1].shapes[0].polygons[0], [[23, 0], [32, 0], [23, 9]])
    assert np.array_equal(raw.key_frames[1].shapes[1].lines[0], [[5, 5], [6, 20]])


VIDEO = """<?xml version="1.0" encoding="utf-8"?>
<annotations>
  <version>1.1</version>
  <meta>
    <{kind}>
      <size>30</size><mode>interpolation</mode>
      <start_frame>100</start_frame><stop_frame>390</stop_frame><frame_filter>step=10</frame_filter>
      <original_size><width>64</width><height>48</height></original_size>
    </{kind}>
  </meta>
  <track id="0" label="wall" source="manual" group_id="4">
    <polygon frame="110" keyframe="1" outside="0" occluded="0" points="0.00,0.00;30.00,0.00;30.00,30.00" z_order="3">
      <attribute name="id">north</attribute>
    </polygon>
    <polygon frame="120" keyframe="0" outside="0" occluded="0" points="0.00,0.00;31.00,0.00;30.00,30.00" z_order="3">
      <attribute name="id">north</attribute>
    </polygon>
  </track>
  <track id="1" label="visible" source="manual">
    <mask frame="120" keyframe="1" outside="0" rle="0, 4" left="3" top="2" width="2" height="2" z_order="0">
      <attribute name="element">north</attribute>
    </mask>
    <mask frame="130" keyframe="1" outside="1" rle="0, 4" left="3" top="2" width="2" height="2" z_order="0">
      <attribute name="element">north</attribute>
    </mask>
  </track>
</annotations>
"""


@pytest.mark.parametrize("kind", ["task", "job"])
def test_frames_of_a_video_task_with_a_step(tmp_path: Path, kind: str) -> None:
    raw = _read(tmp_path, VIDEO.format(kind=kind))
    assert [(k.image, k.image_size, k.number) for k in raw.key_frames] == [
        ("frame_000110", SIZE, 1),
        ("frame_000120", SIZE, 2),
    ]
    assert raw.sequence_length == 30
    assert [w.split(": ", 1)[1] for w in raw.warnings] == [
        "shape in a key frame was interpolated by CVAT, not drawn: check it (1, first in frame_000120)",
    ]
    north, visible = raw.key_frames[1].shapes
    assert (north.id, north.group, north.z_order, visible.element) == ("north", "4", 3, "north")
    assert _same(visible.polygons, shapely.box(3, 2, 5, 4))


def test_frames_with_interpolated_shapes_only_are_said(tmp_path: Path) -> None:
    shape = '<polygon frame="{}" keyframe="{}" outside="0" points="0,0;9,0;9,9"/>'
    shapes = "".join(shape.format(frame, int(frame == 4)) for frame in range(3, 7))
    raw = _read(tmp_path, f'<annotations><track id="0" label="wall">{shapes}</track></annotations>')
    assert [k.image for k in raw.key_frames] == ["frame_000004"]
    assert [line.split(": ", 1)[1] for line in raw.warnings] == [
        "frame left out: all its shapes were interpolated by CVAT, none drawn (3, first in frame_000003)"
    ]


def test_shapes_without_a_label_are_left_out(tmp_path: Path) -> None:
    polygon = '<polygon{} points="0,0;9,0;9,9"/>'
    raw = _read(tmp_path, _image(polygon.format("") + polygon.format(' label=" "') + polygon.format(' label="wall"')))
    assert [s.label for s in raw.key_frames[0].shapes] == ["wall"]
    assert [line.split(": ", 1)[1] for line in raw.warnings] == [
        "polygon skipped: it has no label (2, first in 001.png)"
    ]


def test_the_reasons_stand_in_the_error(tmp_path: Path) -> None:
    nothing = '<points label="wall" points="1,1;2,2"/><points label="wall" points="1,1"/><tag label="wall"/>'
    with pytest.raises(GtlayoutError) as caught:
        build_key_frames(_read(tmp_path, _image(nothing)), [_frame("001.png")], (), {})
    assert str(caught.value).endswith(
        " (points skipped: it is no polygon, polyline, box or mask (2, first in 001.png); "
        "tag skipped: it is no polygon, polyline, box or mask (1, first in 001.png))"
    )
    with pytest.raises(GtlayoutError, match=r"no usable element in any frame \(nothing is drawn in it\)"):
        build_key_frames(_read(tmp_path, _image("")), [_frame("001.png")], (), {})
    kinds = "".join(
        f'<{kind} label="wall"/>' for kind in ("points", "tag", "cuboid", "skeleton", "ellipse", "polygon", "box")
    )
    with pytest.raises(GtlayoutError, match=r"ellipse skipped: [^;]*; and 2 more reasons\)$"):
        build_key_frames(_read(tmp_path, _image(kinds)), [_frame("001.png")], (), {})


def test_grouped_tracks_are_parts_of_one(tmp_path: Path) -> None:
    track = (
        '<track id="{0}" label="wall" group_id="{1}"><polygon frame="2" keyframe="1" outside="0" points="{2}"/></track>'
    )
    raw = _read(
        tmp_path,
        f"<annotations>{track.format(0, 1, '0,0;9,0;9,9')}{track.format(1, 1, '20,0;29,0;29,9')}"
        f"{track.format(2, 0, '40,0;49,0;49,9')}</annotations>",
    )
    assert [(s.id, s.group) for s in raw.key_frames[0].shapes] == [(None, "1"), (None, "1"), ("track_2", None)]
    (key_frame,), _ = build_key_frames(raw, [_frame("frame_000002.png")], (), {})
    assert [(e.id, len(e.amodal.geoms)) for e in key_frame.elements] == [("wall_1", 2), ("track_2", 1)]


def test_the_tasks_of_a_project_are_kept_apart(tmp_path: Path) -> None:
    task = "<task><id>{}</id><size>5</size></task>"
    track = (
        '<track id="{0}" task_id="{0}" label="wall"><polygon frame="2" keyframe="1" outside="0" points="{1}"/></track>'
    )
    raw = _read(
        tmp_path,
        f"<annotations><meta><project><tasks>{task.format(1)}{task.format(2)}</tasks></project></meta>"
        f"{track.format(1, '0,0;9,0;9,9')}{track.format(2, '0,0;8,0;8,8')}</annotations>",
    )
    assert [(k.image, len(k.shapes), k.number) for k in raw.key_frames] == [("frame_000002", 1, 2)] * 2
    assert raw.sequence_length is None


def _image(shapes: str, name: str = "001.png", size: str = 'width="64" height="48"') -> str:
    return f'<annotations><meta/><image id="0" name="{name}" {size}>{shapes}</image></annotations>'


def _read(folder: Path, text: str) -> RawAnnotations:
    (folder / "annotations.xml").write_text(text)
    return read_cvat(folder, folder / "annotations.xml")


def _shapes(folder: Path, shapes: str) -> tuple[RawShape, ...]:
    (key_frame,) = _read(folder, _image(shapes)).key_frames
    return key_frame.shapes


def test_images_of_a_video_task_have_numbers(tmp_path: Path) -> None:
    polygon = '<polygon label="wall" points="0,0;9,0;9,9"/>'
    (key_frame,) = _read(tmp_path, _image(polygon, "frame_000030")).key_frames
    assert key_frame.number == 30
    (key_frame,) = _read(tmp_path, _image(polygon, "frame_000030.png", "")).key_frames
    assert (key_frame.number, key_frame.image_size) == (None, None)


def test_groups_and_attributes_of_shapes(tmp_path: Path) -> None:
    one, two, three = _shapes(
        tmp_path,
        '<polygon label="wall" points="0,0;9,0;9,9" group_id="0"><attribute name="id"></attribute></polygon>'
        '<polygon label="wall" points="0,0;9,0;9,9" group_id="2"><attribute name="ID"> a&#10;b </attribute></polygon>'
        '<polygon label="wall" points="0,0;9,0;9,9" outside="1"/>'
        '<mask label="wall" rle="5, 2, 2, 2, 5" left="2" top="1" width="4" height="4" z_order="-1"/>',
    )
    assert [(s.id, s.group, s.z_order) for s in (one, two, three)] == [
        (None, None, 0),
        ("a b", "2", 0),
        (None, None, -1),
    ]
    assert _same(three.polygons, shapely.box(3, 2, 5, 4))


def test_a_mask_may_have_many_holes(tmp_path: Path) -> None:
    mask = np.ones((8, 6000), dtype=bool)
    for row, column in ((2, 1), (3, 1), (2, 2), (3, 2)):
        mask[row, column::4] = False
    ends = np.flatnonzero(np.diff(mask.ravel())) + 1
    runs = [0, *np.diff([0, *ends, mask.size]).tolist()]
    rle = ", ".join(map(str, runs))
    (wall,) = _shapes(tmp_path, f'<mask label="wall" rle="{rle}" left="0" top="0" width="6000" height="8"/>')
    assert sum(Polygon(ring).area for ring in wall.polygons) == mask.sum() == 42000


@pytest.mark.parametrize(
    ("shape", "told"),
    [
        ('<skeleton label="wall"><points points="1,1"/></skeleton>', "skeleton skipped: it is no"),
        ('<cuboid label="wall" xtl1="3"/>', "cuboid skipped: it is no polygon, polyline, box or mask"),
        ('<polygon label="wall" points="0,0;9,0"/>', "polygon skipped: it has fewer than 3 points"),
        ('<polyline label="wall" points="0,0"/>', "polyline skipped: it has fewer than 2 points"),
        *(
            (f'<polygon label="wall" points="{points}"/>', "polygon skipped: a number is missing or broken")
            for points in ("", "0,0;1", "0,0;9,0;9,9,9", "0,0;nan,0;9,9", "0,0;inf,0;9,9", "0,0;1e7,0;9,9", "a,b")
        ),
        ('<polygon label="wall"/>', "polygon skipped: a number is missing or broken"),
        ('<polygon label="wall" points="0,0;9,0;9,9" z_order="x"/>', "polygon skipped: a number is missing or broken"),
        ('<box label="wall" xtl="1" ytl="1" xbr="5"/>', "box skipped: a number is missing or broken"),
        ('<box label="wall" xtl="1" ytl="1" xbr="5" ybr="5" rotation="inf"/>', "box skipped: a number"),
        ('<mask label="wall" rle="4" left="0" top="-1" width="2" height="2"/>', "mask skipped: a number"),
        ('<mask label="wall" rle="" left="0" top="0" width="2" height="2"/>', "mask skipped: a number"),
        *(
            (
                f'<mask label="wall" rle="{rle}" left="0" top="0" width="2" height="2"/>',
                "mask skipped: its runs do not add up to its size",
            )
            for rle in ("5", "0, 3", "-4, 8", "99999999999", "9223372036854775807, 9223372036854775807, 6")
        ),
        ('<mask label="wall" rle="1" left="0" top="0" width="99999" height="99999"/>', "mask skipped: it has more"),
    ],
)  # fmt: skip
def test_a_broken_shape_is_left_out(tmp_path: Path, shape: str, told: str) -> None:
    good = '<polygon label="floor" points="0,0;9,0;9,9"/>'
    raw = _read(tmp_path, _image(shape + good + shape))
    (warning,) = raw.warnings
    assert warning.startswith(f"annotations.xml: {told}")
    assert warning.endswith(" (2, first in 001.png)")
    assert [shape.label for shape in raw.key_frames[0].shapes] == ["floor"]


def test_a_broken_image_is_left_out(tmp_path: Path) -> None:
    for size in ('width="0" height="5"', 'width="64"', 'width="x" height="5"', 'width="9999999" height="5"'):
        raw = _read(tmp_path, _image('<polygon label="floor" points="0,0;9,0;9,9"/>', size=size))
        told = "annotations.xml: image skipped: its name is missing or its size broken (1, first in 001.png)"
        assert (raw.key_frames, raw.warnings) == ((), (told,))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<annotations>\n<image\n</annotations>", r"is not valid XML: .*line 3"),
        ("", "is not valid XML: no element found: line 1"),
        ('<?xml version="1.0" encoding="no-such"?><annotations/>', "is not valid XML"),
        ("<annotation/>", "is no CVAT file"),
        ("<!DOCTYPE annotations><annotations/>", "document type or entities"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><annotations>&b;</annotations>', "document type or entities"),
        ('<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hostname">]><annotations>&b;</annotations>', "document type"),
    ],
)
def test_a_file_that_is_no_such_xml_is_refused(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(GtlayoutError, match=told) as error:
        _read(tmp_path, text)
    assert str(error.value).startswith(str(tmp_path / "annotations.xml"))
    assert "\n" not in str(error.value)


SCENE = """<annotations><meta/>
  <image id="0" name="000.png" width="64" height="48"></image>
  <image id="1" name="001.png" width="64" height="48">
    <polygon label="Wand" points="0,0;64,0;64,30;0,30" group_id="1"/>
    <polygon label="Saeule" points="20,0;30,0;30,40;20,40" z_order="1"><attribute name="id">pillar</attribute></polygon>
    <polygon label="floor" points="0,30;64,30;64,48;0,48"/>
    <polygon label="Wand" points="40,30;50,30;50,35;40,35" group_id="1" z_order="1"/>
    <polygon label="visible" points="21,1;29,1;29,9;21,9"><attribute name="element">pillar</attribute></polygon>
    <polygon label="visible" points="41,25;49,25;49,34;41,34" group_id="1"/>
    <polyline label="occlusion_edge" points="20,0;20,40"/>
    <polygon label="sofa" points="0,0;9,0;9,9"/>
  </image>
</annotations>
"""


def test_a_scene_annotated_with_cvat(tiny: Path) -> None:
    (tiny / "annotations.json").unlink()
    (tiny / "annotations.xml").write_text(SCENE)
    (tiny / "labels.json").write_text('{"Wand": "wall", "Saeule": "wall", "sofa": null}')
    scene = load_scene(tiny)
    assert scene.warnings == ()
    (key_frame,) = scene.key_frames
    assert key_frame.frame == 1
    elements = {e.id: (e.label, e.amodal.area, e.visible.area) for e in key_frame.elements}
    assert elements == {
        "wall_1": ("wall", 64 * 30 + 50, 72),
        "pillar": ("wall", 400, 64),
        "floor_1": ("floor", 64 * 18 - 100 - 50, 0),
    }
    assert np.array_equal(key_frame.occlusion_edges[0], [[20, 0], [20, 40]])


def _frame(name: str, size: tuple[int, int] = SIZE) -> Frame:
    return Frame(name, Path(name), Camera(np.eye(3), np.eye(3), np.zeros(3), *size))


def _layout() -> list[KeyFrame]:
    ring = MultiPolygon([shapely.box(2, 2, 30.25, 20) - shapely.box(5.11, 6, 9, 9.37) - shapely.box(12, 4, 20, 8)])
    parts = MultiPolygon([shapely.box(40, 0, 50, 10), shapely.box(40, 20.5, 50, 30)])
    elements = (
        Element("a & <b>", "wall", ring, MultiPolygon([shapely.box(21, 3, 29, 19)])),
        Element("7", "door", parts, MultiPolygon()),
    )
    return [KeyFrame(1, elements, (np.array([[0.123, 1], [5, 47.999], [6, 7]]),))]


def test_what_we_write_is_read_back(tmp_path: Path) -> None:
    frames, layout = [_frame("000.png"), _frame("001.png")], _layout()
    path = tmp_path / "annotations.xml"
    write_cvat(path, frames, layout)
    read, warnings = build_key_frames(read_cvat(tmp_path, path), frames, (), {})
    assert warnings == []
    assert [k.frame for k in read] == [1]
    for element, same in zip(layout[0].elements, read[0].elements, strict=True):
        assert (element.id, element.label) == (same.id, same.label)
        assert element.amodal.symmetric_difference(same.amodal).area < 1e-9
        assert [len(part.interiors) for part in same.amodal.geoms] == [len(p.interiors) for p in element.amodal.geoms]
        assert element.visible.symmetric_difference(same.visible).area < 1e-9
    assert np.allclose(read[0].occlusion_edges[0], layout[0].occlusion_edges[0], atol=0.005)


def test_what_we_write_is_read_by_datumaro(tiny: Path) -> None:
    frames = load_scene(tiny).frames
    write_cvat(tiny / "annotations.xml", frames, _layout())
    seen = json.loads(run_tool("read_cvat.py", str(tiny / "annotations.xml")))
    assert {*LABELS, "visible", "blank", "occlusion_edge", PROPOSED} == set(seen["labels"])
    (shapes,) = seen["items"].values()
    line = shapes[-1]
    assert (line["type"], line["label"]) == ("polyline", "occlusion_edge")
    assert line["points"] == pytest.approx([0.12, 1, 5, 48, 6, 7])
    area = sum(
        Polygon(np.reshape(shape["points"], (-1, 2))).area
        for shape in shapes
        if shape["attributes"].get("id") == "a & <b>"
    )
    assert area == pytest.approx(_layout()[0].elements[0].amodal.area, abs=1e-6)
    assert [s["attributes"]["element"] for s in shapes if s["label"] == "visible"] == ["a & <b>"]
