"""Labels, parts, visible parts and overlaps: from shapes as a tool knows them to elements."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon, box

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import AnnotationKind, files_of_kind
from gtlayout.io.annotations.elements import DrawnElement, DrawnVisible, assemble
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.labels import Kind, label_meanings, meaning, read_label_file
from gtlayout.io.annotations.outlines import MOST_CLICKED, REDUNDANT_PX, Repairs, View, region
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.sources import RawAnnotations, RawKeyFrame, RawShape
from gtlayout.scene import Camera, FloatArray, Frame, Label


@pytest.mark.parametrize(
    ("label", "kind"),
    [
        *((kind, kind) for kind in ("floor", "ceiling", "wall", "slanted", "door", "window", "visible", "blank")),
        ("Floor", "floor"),
        ("floor_1", "floor"),
        ("WALL 02", "wall"),
        ("wall.001", "wall"),
        ("Windows", "window"),
        ("slanted ceiling", "slanted"),
        ("Visible part", "visible"),
        ("occlusion-edge", "occlusion_edge"),
        ("OcclusionEdge", "occlusion_edge"),
        ("sofa", None),
        ("", None),
        ("12", None),
        ("ignored", None),
    ],
)
def test_labels_by_default(label: str, kind: Kind | None) -> None:
    assert meaning(label, label_meanings({})) == kind


def test_own_labels_go_first(tmp_path: Path) -> None:
    path = tmp_path / "labels.json"
    assert read_label_file(path) == {}
    path.write_text('{"Wand": "wall", "Boden_2": "ceiling", "Boden": "floor", "sofa": null, "door": "window"}')
    meanings = label_meanings(read_label_file(path))
    read = {label: meaning(label, meanings) for label in ("Wand 3", "Boden_2", "Boden_1", "Sofa", "door", "floor")}
    assert read == {
        "Wand 3": "wall",
        "Boden_2": "ceiling",
        "Boden_1": "floor",
        "Sofa": "ignored",
        "door": "window",
        "floor": "floor",
    }
    for bad in ('{"Wand": "Mauer"}', '{"Wand": 3}', "[]", '{"Wand": ["wall"]}'):
        path.write_text(bad)
        with pytest.raises(GtlayoutError, match=r"labels\.json"):
            read_label_file(path)


def test_own_labels_in_a_scene(tiny: Path) -> None:
    text = (tiny / "annotations.json").read_text()
    (tiny / "annotations.json").write_text(text.replace('"wall"', '"Wand 1"'))
    with pytest.raises(GtlayoutError, match=r"2 shapes with unknown label 'Wand 1' .*labels\.json can say"):
        load_scene(tiny)
    (tiny / "labels.json").write_text('{"Wand": "wall"}')
    assert load_scene(tiny).key_frames[0].elements[0].label == "wall"


def _region(*boxes: tuple[float, float, float, float]) -> MultiPolygon:
    return MultiPolygon([shapely.box(*box) for box in boxes])


def _drawn(label: Label, *boxes: tuple[float, float, float, float], **kwargs: object) -> DrawnElement:
    said = {"id": None, "group": None, "z_order": 0, "visible": MultiPolygon(), **kwargs}
    return DrawnElement(label, _region(*boxes), **said)


def test_parts_are_put_together() -> None:
    elements, notes = assemble(
        [
            _drawn("wall", (0, 0, 10, 10), group="7"),
            _drawn("floor", (0, 10, 20, 20), group="7"),
            _drawn("wall", (15, 0, 20, 10), group="7"),
            _drawn("wall", (30, 0, 40, 10), id="a"),
            _drawn("wall", (40, 0, 50, 10), id="a"),
            _drawn("door", (42, 0, 48, 10), id="a"),
            _drawn("wall", (60, 0, 70, 10)),
        ],
        [],
    )
    assert notes == []
    assert [(e.id, e.label, e.amodal.area) for e in elements] == [
        ("wall_1", "wall", 150),
        ("floor_1", "floor", 200),
        ("a", "wall", 200),
        ("door_1", "door", 60),
        ("wall_2", "wall", 100),
    ]


def test_visible_parts_find_their_elements() -> None:
    wall = _drawn("wall", (0, 0, 100, 50), id="w", group="1")
    door = _drawn("door", (60, 0, 100, 50), id="d")
    floor = _drawn("floor", (0, 50, 100, 100), group="2")
    visible = [
        DrawnVisible(_region((10, 10, 20, 20)), None, None),  # on the wall only
        DrawnVisible(_region((70, 10, 80, 20)), None, None),  # on door and wall alike: the door is smaller
        DrawnVisible(_region((70, 30, 80, 40)), "w", None),  # said
        DrawnVisible(_region((62, 40, 66, 44)), None, "1"),  # grouped
        DrawnVisible(_region((0, 40, 50, 60)), "floor_1", None),  # said by the name it is given
        DrawnVisible(_region((30, 45, 40, 52)), None, None),  # more wall than floor
        DrawnVisible(_region((0, 90, 10, 95)), "nobody", None),
        DrawnVisible(_region((200, 200, 210, 210)), None, None),
    ]
    elements, notes = assemble([wall, door, floor], visible)
    areas = {element.id: element.visible.area for element in elements}
    assert areas == {"w": 100 + 100 + 16 + 70, "d": 100, "floor_1": 1000 + 50}
    assert notes == [
        "a visible part belongs to element nobody, which is not there: given to what it overlaps most",
        "a visible part lies on no element, dropped",
    ]


def test_the_higher_surface_is_in_front() -> None:
    back = _drawn("wall", (0, 0, 100, 50), id="back")
    pillar = _drawn("wall", (40, 0, 60, 80), id="pillar", z_order=2)
    door = _drawn("door", (10, 0, 30, 50), id="door", z_order=5)
    window = _drawn("window", (55, 0, 70, 20), id="window", z_order=1)
    hidden = _drawn("wall", (45, 10, 55, 20), id="hidden", z_order=1)
    elements, notes = assemble([back, pillar, door, window, hidden], [])
    assert {e.id: e.amodal.area for e in elements} == {
        "back": 100 * 50 - 20 * 50,
        "pillar": 1600,
        "door": 1000,
        "window": 300,
    }
    assert notes == ["element hidden: elements with a higher z-order cover all of it, dropped"]


def _box(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    return np.array(Polygon(shapely.box(x0, y0, x1, y1)).exterior.coords)[:-1]


def test_shapes_of_the_wrong_kind_are_told(tiny: Path) -> None:
    frames = load_scene(tiny).frames
    line = np.array([[0.0, 0.0], [10.0, 10.0]])
    shapes = (
        RawShape("wall", (_box(0, 0, 30, 30),), id="a"),
        RawShape("wall", lines=(line,)),
        RawShape("occlusion edge", (_box(0, 0, 9, 9),)),
        RawShape("occlusion edge", lines=(line,)),
        RawShape("visible", (_box(5, 5, 10, 10),)),
        RawShape("sofa", (_box(5, 5, 10, 10),)),
    )
    raw = RawAnnotations(Path("x.xml"), (RawKeyFrame("001", shapes, None),))
    (key_frame,), warnings = build_key_frames(raw, frames, (), {})
    (element,) = key_frame.elements
    assert element.visible.area == 25
    assert len(key_frame.occlusion_edges) == 1
    assert [w.split(" dropped")[0] for w in warnings] == [
        "x.xml: 1 shapes with unknown label 'sofa'",
        "001, shape 2 (wall): a polyline encloses no area,",
        "001, shape 3 (occlusion edge): an occlusion edge is a polyline, the polygon was",
    ]


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ('{"format": "gtlayout-annotations/1"', "native"),
        ('{"version": "5.5", "flags": {}, "shapes": [', "labelme"),
        ('[{"id": 1, "annotations": [', "label-studio"),
        ('{"info": {}, "licenses": [], "categories": [{"id": 1}], "images": [', "coco"),
        ('{"annotations": [{"id": 3, "image_id": 1, "category_id": 2', "coco"),
        ('{"frames": [], "camera_model": "OPENCV"}', None),
        ('{"metric": true}', None),
        ("\xff\x00", None),
    ],
)
def test_files_are_told_by_their_content(tmp_path: Path, text: str, kind: str | None) -> None:
    (tmp_path / "some.json").write_bytes(text.encode("latin-1"))
    assert [each for each in get_args(AnnotationKind) if files_of_kind(each)(tmp_path)] == ([kind] if kind else [])


def test_annotation_files_are_looked_for_in_folders_last(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    below, here = tmp_path / "below/annotations.xml", tmp_path / "job.xml"
    below.write_text("<?xml version='1.0'?><annotations>")
    find = files_of_kind("cvat")
    assert find(tmp_path) == [below]
    here.write_text("<annotations/>")
    assert find(tmp_path) == [here]
    (tmp_path / "annotations.json").write_text("garbage")
    assert files_of_kind("native")(tmp_path) == [tmp_path / "annotations.json"]


def _at_the_door(outline_px: FloatArray, size: tuple[int, int] = (640, 480)) -> MultiPolygon:
    camera = Camera(np.diag([500.0, 500, 1]), np.eye(3), np.zeros(3), *size)
    view = View.of("0.png", Frame("0.png", Path("0.png"), camera), None)
    return region([outline_px], view, "0.png", Repairs())


WALL_PX = np.array([[100.0, 50], [500, 90], [520, 400], [90, 430]])


@pytest.mark.parametrize("spacing_px", [4.0, 0.1])
def test_vertices_on_the_sides_of_a_polygon_go_at_the_door(spacing_px: float) -> None:
    fine = shapely.get_coordinates(shapely.segmentize(Polygon(WALL_PX), spacing_px))[:-1]
    for first in (0, 7, len(fine) // 2):
        (wall,) = _at_the_door(np.roll(fine, first, axis=0)).geoms
        assert {tuple(corner) for corner in np.array(wall.exterior.coords)} == {tuple(corner) for corner in WALL_PX}


@pytest.mark.parametrize("scale", [1, 4])
def test_a_smooth_outline_of_10_000_vertices_keeps_its_shape_with_few(scale: int) -> None:
    angle = np.linspace(0, 2 * np.pi, 10_000, endpoint=False)
    arch = scale * np.column_stack([320 + 200 * np.cos(angle), 240 + 150 * np.sin(angle)])
    (found,) = _at_the_door(arch, (640 * scale, 480 * scale)).geoms
    assert shapely.get_num_coordinates(found) < 100
    assert shapely.hausdorff_distance(found, Polygon(arch), densify=0.01) <= REDUNDANT_PX * scale
    assert found.area == pytest.approx(Polygon(arch).area, rel=5e-3)


def test_vertices_that_a_hand_has_clicked_stay() -> None:
    """Also those on a straight side."""
    clicked = shapely.get_coordinates(shapely.segmentize(Polygon(WALL_PX), 30.0))[:-1]
    assert 40 < len(clicked) < MOST_CLICKED
    np.testing.assert_array_equal(shapely.get_coordinates(_at_the_door(clicked))[:-1], clicked)


def test_drawn_twice_is_one() -> None:
    wall = DrawnElement("wall", MultiPolygon([box(0, 0, 100, 100)]), MultiPolygon(), "a", None, 0)
    again = replace(wall, amodal=MultiPolygon([box(0, 0, 100, 96)]), visible=MultiPolygon([box(5, 5, 50, 50)]), id="b")
    others = replace(again, amodal=MultiPolygon([box(0, 0, 100, 88)]), id="c"), replace(again, label="door", id="d")
    elements, notes = assemble([wall, again, *others], [])
    assert [element.id for element in elements] == ["a", "c", "d"]
    assert notes == ["wall b left out: almost the same polygon as wall a"]
    assert elements[0].amodal.equals(wall.amodal)
    assert elements[0].visible.equals(again.visible)
