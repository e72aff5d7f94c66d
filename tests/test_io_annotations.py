"""The native annotation file: round trip, what is repaired, what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.native import write_annotations
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import Element, KeyFrame

Edit = Callable[[Path, Callable[[Any], object]], None]


@pytest.mark.parametrize(
    ("polygons", "area", "says"),
    [
        ([[[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]], 100, None),  # closed: fine
        ([[[0, 0], [10, 0], [10, 10], [0, 10]], [[5, 0], [20, 0], [20, 10], [5, 10]]], 200, None),  # overlap
        ([[[0, 0], [20, 20], [20, 0], [0, 20]]], 200, "self-crossing polygon repaired"),
        # covers the square from (10, 10) to (20, 20) twice
        ([[[0, 10], [30, 10], [30, 30], [10, 30], [10, 0], [20, 0], [20, 20], [0, 20]]], 600, "self-crossing"),
        ([[[0, 0], [64.8, 0], [64.8, 10], [0, 10]]], 640, None),  # rounding
        ([[[-10, -10], [10, -10], [10, 10], [-10, 10]]], 100, "1 polygons reach beyond the image"),
        ([[[0, 0], [10, 0]], [[0, 0], [10, 0], [10, 10]]], 50, "element e0: polygon with fewer than 3 points dropped"),
        ([[[0, 0], [10, 0], [0, 0]], [[0, 0], [10, 0], [10, 10]]], 50, "fewer than 3 points"),
        ([[[0, 0], [10, 0], [20, 0]], [[0, 0], [10, 0], [10, 10]]], 50, "polygon without area dropped"),
        ([[[70, 0], [80, 0], [80, 9]], [[0, 0], [10, 0], [10, 10]]], 50, "polygon off the image dropped"),
    ],
)
def test_polygons_are_repaired(tiny: Path, edit_json: Edit, polygons: Any, area: float, says: str | None) -> None:
    edit_json(tiny / "annotations.json", lambda d: d["frames"][0]["elements"][0].update(polygons=polygons))
    scene = load_scene(tiny)
    element = scene.key_frames[0].elements[0]
    assert element.amodal.is_valid
    assert element.amodal.area == pytest.approx(area)
    assert len(scene.warnings) == (says is not None)
    if says is not None:
        assert says in scene.warnings[0]


def test_hopeless_elements_are_dropped(tiny: Path, edit_json: Edit) -> None:
    def change(data: Any) -> None:
        good = data["frames"][0]["elements"][0]
        data["frames"][0]["elements"] += [
            {**good, "id": "off", "polygons": [[[70, 0], [80, 0], [80, 9]]]},
            {**good, "id": "c1", "label": "cupboard"},
            {**good, "id": "c2", "label": "cupboard"},
        ]
        data["frames"].append({"image": "004.png", "elements": []})

    edit_json(tiny / "annotations.json", change)
    scene = load_scene(tiny)
    assert [len(key.elements) for key in scene.key_frames] == [1, 1]
    text = "\n".join(scene.warnings)
    assert "annotations.json: 2 shapes with unknown label 'cupboard' dropped" in text
    assert "001.png, element off: no polygon left within the image" in text
    assert "004.png: no element annotated" in text


def test_occlusion_edges_are_clipped(tiny: Path, edit_json: Edit) -> None:
    lines = [[[10, -10], [10, 20]], [[1, 1], [5, 5], [9, 1]], [[3, 3]], [[70, 0], [80, 0]]]
    edit_json(tiny / "annotations.json", lambda d: d["frames"][0].update(occlusion_edges=lines))
    scene = load_scene(tiny)
    clipped, kept = scene.key_frames[0].occlusion_edges
    assert sorted(clipped.tolist()) == [[10, 0], [10, 20]]
    assert kept.tolist() == lines[1]
    assert scene.warnings == ("001.png: occlusion edge with fewer than 2 points dropped",)


def test_annotations_without_any_visible_part_are_told(tiny: Path, edit_json: Edit) -> None:
    edit_json(tiny / "annotations.json", lambda d: _element(d).update(visible=[]))
    assert load_scene(tiny).warnings == ()
    edit_json(tiny / "annotations.json", lambda d: d["frames"][1]["elements"][0].update(visible=[]))
    (warning,) = load_scene(tiny).warnings
    assert warning.startswith("no visible parts drawn")


def _element(data: Any) -> Any:
    return data["frames"][0]["elements"][0]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.update(format="coco"), "format is 'coco', expected"),
        (lambda d: d.update(frames={}), "annotations.json: frames must be a list"),
        (lambda d: d.update(frames=[]), "no usable element"),
        (lambda d: [f.update(elements=[]) for f in d["frames"]], "no usable element"),
        (lambda d: d.update(image_size=[128, 90]), "001.png was annotated at 128x90 px but its camera says 64x48"),
        (lambda d: d.update(image_size=[48, 64]), "annotated at 48x64 px .*: remove the EXIF orientation"),
        (lambda d: d.update(image_size=[64]), "image_size must be"),
        (lambda d: [f.update(image="777.png") for f in d["frames"]], "annotated image 777.png has no camera"),
        (
            lambda d: [f.update(elements=None) for f in d["frames"]],
            r"no usable element in any frame \(elements skipped: it is no list \(2, first in 001.png\); 001.png: no",
        ),
    ],
)
def test_bad_annotations(tiny: Path, edit_json: Edit, change: Callable[[Any], object], says: str) -> None:
    edit_json(tiny / "annotations.json", change)
    with pytest.raises(GtlayoutError, match=says) as caught:
        load_scene(tiny)
    assert "\n" not in str(caught.value)
    assert "annotations.json" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["frames"].append({"elements": []}), "frame skipped: it has no image name (1, first in frame num"),
        (lambda d: d["frames"].append(7), "frame skipped: it has no image name (1, first in frame number 2)"),
        (lambda d: _add(d, "x"), "element skipped: it has no id (1, first in 001.png, element number 1)"),
        (lambda d: _add(d, id=None), "element skipped: it has no id (1, first in 001.png, element number 1)"),
        (lambda d: _add(d, label=3.5), "element skipped: it has no label (1, first in 001.png, element number 1)"),
        (lambda d: _add(d, polygons={}), "polygons skipped: it is no list (1, first in 001.png, element e1)"),
        (
            lambda d: _add(d, polygons=[[[0, 0], [1]]]),
            "line in polygons skipped: its points are no pairs of finite numb",
        ),
        (lambda d: _add(d, polygons=[[[0, "1"]]]), "(1, first in 001.png, element e1: polygons[0])"),
        (lambda d: _element(d)["polygons"].append([[0, 10**400]]), "(1, first in 001.png, element e0: polygons[1])"),
        (lambda d: _element(d)["visible"].append([[0, float("nan")]]), "line in visible skipped: its points are no p"),
        (
            lambda d: _element(d).update(visible=[[[0, 0], [float("inf"), 0]]]),
            "line in visible skipped: its points are",
        ),
        (lambda d: d["frames"][0].update(occlusion_edges=[1]), "line in occlusion_edges skipped: its points are no p"),
        (
            lambda d: _add(d, id="e0"),
            "element skipped: another of its frame has its id (1, first in 001.png, element e0",
        ),
    ],
)
def test_a_bad_line_element_or_frame_costs_only_itself(
    tiny: Path, edit_json: Edit, change: Callable[[Any], object], says: str
) -> None:
    edit_json(tiny / "annotations.json", change)
    scene = load_scene(tiny)
    assert [[e.id for e in key.elements] for key in scene.key_frames] == [["e0"], ["e0"]]
    assert [key.elements[0].amodal.area for key in scene.key_frames] == [64 * 48] * 2
    assert sum(says in line for line in scene.warnings) == 1, scene.warnings


def test_a_number_of_thousands_of_digits_costs_only_its_polygon(tiny: Path, edit_json: Edit) -> None:
    edit_json(tiny / "annotations.json", lambda d: _element(d)["polygons"].append([[0, 123456789]]))
    path = tiny / "annotations.json"
    path.write_text(path.read_text().replace("123456789", "9" * 5000))
    scene = load_scene(tiny)
    assert [key.elements[0].amodal.area for key in scene.key_frames] == [64 * 48] * 2
    assert any("line in polygons skipped" in line for line in scene.warnings)


def _add(data: Any, element: Any = None, **fields: Any) -> None:
    """A further element of the first frame."""
    data["frames"][0]["elements"].append({**_element(data), "id": "e1", **fields} if element is None else element)


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (lambda r, edit: (r / "images/003.png").unlink(), "annotated image 003.png has no image file"),
        (lambda r, edit: edit(r / "transforms.json", lambda d: d["frames"].pop(3)), "image 003.png has no camera"),
        (
            lambda r, edit: _annotated(r, edit, image="777.png"),
            "annotations.json: annotated image 777.png has no camera",
        ),
        (lambda r, edit: _annotated(r, edit, image="./images/001.png"), "images/001.png is annotated twice"),
    ],
)
def test_one_bad_image_costs_only_itself(
    tiny: Path, edit_json: Edit, break_it: Callable[..., object], says: str
) -> None:
    break_it(tiny, edit_json)
    scene = load_scene(tiny)
    assert [scene.frame_of(k).name for k in range(len(scene.key_frames))] == ["001.png"]
    assert says in "\n".join(scene.warnings)


def _annotated(root: Path, edit_json: Edit, image: str) -> None:
    edit_json(root / "annotations.json", lambda d: d["frames"][1].update(image=image))


def test_drawings_on_larger_copies_are_scaled(tiny: Path, edit_json: Edit) -> None:
    before = load_scene(tiny)
    edit_json(tiny / "annotations.json", lambda d: d.update(image_size=[128, 96]))
    scene = load_scene(tiny)
    (warning,) = scene.warnings
    assert "2 images were annotated in another size, first 001.png at 128x96 px instead of 64x48" in warning
    drawn, scaled = (each.key_frames[0].elements[0].visible.area for each in (before, scene))
    assert scaled == pytest.approx(drawn / 4)


def test_written_annotations_read_back(tiny: Path) -> None:
    hole = shapely.box(20, 20, 30, 30).exterior.coords
    with_holes = MultiPolygon([Polygon(shapely.box(5, 5, 60, 40).exterior.coords, [hole])])
    apart = MultiPolygon([shapely.box(0, 0, 10.125, 10), shapely.box(20, 20, 30, 30.1)])
    elements = (Element("a", "wall", with_holes, apart), Element("b", "floor", apart, MultiPolygon()))
    edge = np.array([[0.0, 0.0], [10.5, 20.25]])
    before = load_scene(tiny)
    path = tiny / "annotations.json"
    write_annotations(path, before.frames, [KeyFrame(2, elements, (edge,))])
    first_bytes = path.read_bytes()
    after = load_scene(tiny)
    assert after.warnings == ()
    assert len(after.key_frames) == 1
    assert after.key_frames[0].frame == 2
    assert after.key_frames[0].occlusion_edges[0].tolist() == edge.tolist()
    for read, written in zip(after.key_frames[0].elements, elements, strict=True):
        assert (read.id, read.label) == (written.id, written.label)
        assert (read.amodal ^ written.amodal).area == pytest.approx(0, abs=1e-9)
        assert (read.visible ^ written.visible).area == pytest.approx(0, abs=1e-9)
    write_annotations(path, before.frames, [KeyFrame(2, elements, (edge,))])
    assert path.read_bytes() == first_bytes
