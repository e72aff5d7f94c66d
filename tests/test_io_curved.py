"""The attribute ``curved`` of walls, in every format that has attributes, and what is said where it makes no sense."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import shapely
from label_studio_writer import region, task
from shapely import MultiPolygon

from gtlayout.io.annotations.checked import Notes, is_curved
from gtlayout.io.annotations.coco.reader import read_coco, write_coco
from gtlayout.io.annotations.cvat.reader import read_cvat
from gtlayout.io.annotations.cvat.writer import write_cvat
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.label_studio.reader import read_label_studio
from gtlayout.io.annotations.labelme import read_labelme, write_labelme
from gtlayout.io.annotations.native import read_annotations, write_annotations
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.sources import RawAnnotations
from gtlayout.scene import Element, Frame, KeyFrame

ROUND = Element("w", "wall", MultiPolygon([shapely.box(2, 3, 30, 40)]), MultiPolygon(), curved=True)
FLAT = Element("v", "wall", MultiPolygon([shapely.box(30, 3, 60, 40)]), MultiPolygon())
Writer = Callable[[Path, Sequence[Frame], Sequence[KeyFrame]], None]
Reader = Callable[[Path, Path], RawAnnotations]
FORMATS: dict[str, tuple[str, Writer, Reader]] = {
    "native": ("a.json", write_annotations, read_annotations),
    "cvat": ("a.xml", write_cvat, read_cvat),
    "coco": ("a.json", write_coco, read_coco),
    "labelme": ("labelme", write_labelme, read_labelme),
}
SQUARE = [[5.0, 5.0], [50.0, 5.0], [50.0, 50.0], [5.0, 50.0]]


@pytest.mark.parametrize("name", FORMATS)
def test_curved_walls_come_back(name: str, tiny: Path) -> None:
    file, write, read = FORMATS[name]
    frames = load_scene(tiny).frames
    write(tiny / file, frames, [KeyFrame(1, (ROUND, FLAT))])
    raw = read(tiny, tiny / file)
    (key_frame,), _ = build_key_frames(raw, frames, (), {})
    assert [(element.id, element.curved) for element in key_frame.elements] == [("w", True), ("v", False)]


@pytest.mark.parametrize("name", FORMATS)
def test_nothing_of_it_is_written_where_all_is_flat(name: str, tiny: Path) -> None:
    file, write, _ = FORMATS[name]
    write(tiny / file, load_scene(tiny).frames, [KeyFrame(1, (replace(ROUND, curved=False),))])
    written = list((tiny / file).rglob("*.json")) or [tiny / file]
    # CVAT's file describes its labels, too.
    assert all(">true<" not in path.read_text() and '"curved":' not in path.read_text() for path in written)


def _label_studio(tiny: Path, said: dict[str, Any]) -> RawAnnotations:
    results = region("a", {"points": SQUARE}, (64, 48), kind="polygonlabels", label="wall")
    results.append({"id": "a", "from_name": "curved", "to_name": "image", "type": "choices", "value": said})
    path = tiny / "project.json"
    path.write_text(json.dumps([task(1, "001.png", results)]))
    return read_label_studio(tiny, path)


@pytest.mark.parametrize(("choices", "expected"), [(["curved"], True), (["no"], False), ([], False)])
def test_label_studio_has_a_choice(choices: list[str], expected: bool, tiny: Path) -> None:
    raw = _label_studio(tiny, {"choices": choices})
    assert raw.warnings == ()
    (shape,) = raw.key_frames[0].shapes
    assert (shape.label, shape.curved) == ("wall", expected)


def test_label_studio_may_have_it_in_a_note(tiny: Path) -> None:
    results = region("a", {"points": SQUARE}, (64, 48), kind="polygonlabels", label="wall")
    results[0]["meta"] = {"text": ["curved: yes"]}
    path = tiny / "project.json"
    path.write_text(json.dumps([task(1, "001.png", results)]))
    assert [shape.curved for shape in read_label_studio(tiny, path).key_frames[0].shapes] == [True]


def test_what_is_neither_true_nor_false_is_said_once(tiny: Path) -> None:
    raw = _label_studio(tiny, {"choices": ["rather"]})
    assert raw.warnings == (
        "project.json: curved is rather, neither true nor false: taken as false (1, first in 001.png)",
    )
    assert not raw.key_frames[0].shapes[0].curved


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        *((said, True) for said in (True, "True", "1", 1, " YES ", "curved")),
        *((said, False) for said in (None, False, "", "false", 0, "no")),
    ],
)
def test_yes_and_no_as_tools_write_them(value: object, expected: bool) -> None:
    notes = Notes()
    assert is_curved(value, notes, "w") is expected
    assert notes.lines("f") == []


@pytest.mark.parametrize(("value", "shown"), [([True], "of type list"), ("rather", "rather"), (2, "2"), (0.5, "float")])
def test_other_values_are_named(value: object, shown: str) -> None:
    notes = Notes()
    assert not is_curved(value, notes, "w")
    (line,) = notes.lines("f")
    assert shown in line and "neither true nor false" in line


def test_only_walls_are_curved(tiny: Path) -> None:
    frames = load_scene(tiny).frames
    write_annotations(tiny / "a.json", frames, [KeyFrame(1, (replace(ROUND, label="floor"),))])
    (key_frame,), warnings = build_key_frames(read_annotations(tiny, tiny / "a.json"), frames, (), {})
    assert not key_frame.elements[0].curved
    assert any("element w: only a wall can be curved, this floor is read as flat" in line for line in warnings)


def test_one_part_that_is_curved_makes_its_element_so(tiny: Path) -> None:
    frames = load_scene(tiny).frames
    parts = MultiPolygon([shapely.box(2, 3, 10, 40), shapely.box(20, 3, 30, 40)])
    write_cvat(tiny / "a.xml", frames, [KeyFrame(1, (replace(ROUND, amodal=parts),))])
    text = (tiny / "a.xml").read_text().replace('<attribute name="curved">true', '<attribute name="curved">false', 1)
    (tiny / "a.xml").write_text(text)
    (key_frame,), _ = build_key_frames(read_cvat(tiny, tiny / "a.xml"), frames, (), {})
    assert [(element.id, element.curved) for element in key_frame.elements] == [("w", True)]
