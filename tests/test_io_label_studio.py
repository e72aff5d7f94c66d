"""Label Studio's JSON export, its brush masks, and files its own converter makes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from label_studio_writer import label_studio_json, pack, region, task, write_label_studio
from shapely import MultiPolygon, Polygon
from tools_env import run_tool

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.label_studio.reader import read_label_studio
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.sources import RawAnnotations, RawShape
from gtlayout.scene import Element, FloatArray, KeyFrame

SIZE = (64, 48)
CONFIG = """<View><Image name="image" value="$image"/>
<PolygonLabels name="polygon" toName="image"><Label value="wall"/><Label value="floor"/></PolygonLabels>
<BrushLabels name="brush" toName="image"><Label value="wall"/></BrushLabels></View>"""


Point = tuple[float, float]


def percent(points_px: Any, size: tuple[int, int] = SIZE) -> list[list[float]]:
    return [[x / size[0] * 100, y / size[1] * 100] for x, y in points_px]


def square(x0: float, y0: float, x1: float, y1: float) -> list[Point]:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def polygon(region_id: str, label: str, points_px: Any, **texts: str) -> list[dict[str, Any]]:
    return region(region_id, {"points": percent(points_px)}, SIZE, kind="polygonlabels", label=label, **texts)


def read(folder: Path, tasks: Any) -> RawAnnotations:
    path = folder / "project-1.json"
    path.write_text(json.dumps(tasks))
    return read_label_studio(folder, path)


def shapes(folder: Path, results: list[dict[str, Any]], image: str = "001.png") -> tuple[RawShape, ...]:
    return read(folder, [task(1, image, results)]).key_frames[0].shapes


def area_px2(shape: RawShape) -> float:
    return float(shapely.union_all([Polygon(ring) for ring in shape.polygons]).area)


def test_key_frames_come_back_from_label_studio(tiny: Path) -> None:
    frames = load_scene(tiny).frames
    holed = shapely.box(2, 3, 40, 40) - shapely.box(10, 11, 20.5, 23) - shapely.box(25, 12, 30, 30)
    elements = (
        Element(
            "w", "wall", MultiPolygon([holed, shapely.box(45, 1, 60, 33)]), MultiPolygon([shapely.box(3, 4, 9, 9)])
        ),
        Element("f", "floor", MultiPolygon([shapely.box(0, 40, 64, 48)]), MultiPolygon()),
    )
    edges = (np.array([[40.0, 3.0], [42.5, 17.125], [41.0, 40.0]]), np.array([[0.0, 0.0], [64.0, 48.0]]))
    write_label_studio(tiny / "export.json", frames, [KeyFrame(1, elements, edges), KeyFrame(4, elements[1:])])
    raw = read_label_studio(tiny, tiny / "export.json")
    key_frames, warnings = build_key_frames(raw, frames, (), {})
    assert (raw.warnings, warnings) == ((), [])
    assert [k.frame for k in key_frames] == [1, 4]
    for got, expected in zip(key_frames, (elements, elements[1:]), strict=True):
        assert [(e.id, e.label) for e in got.elements] == [(e.id, e.label) for e in expected]
        for element, true in zip(got.elements, expected, strict=True):
            assert (element.amodal ^ true.amodal).area < 1e-9
            assert (element.visible ^ true.visible).area < 1e-9
    for edge, true_edge in zip(key_frames[0].occlusion_edges, edges, strict=True):
        np.testing.assert_allclose(edge, true_edge, atol=1e-9)


def test_it_is_found_in_a_scene_folder(tiny: Path) -> None:
    scene = load_scene(tiny)
    (tiny / "annotations.json").unlink()
    write_label_studio(tiny / "project-3-at-2025-03-09.json", scene.frames, scene.key_frames)
    again = load_scene(tiny)
    assert [(k.frame, k.elements[0].visible.area) for k in again.key_frames] == [(1, 312.5), (3, 312.5)]
    assert again.warnings == scene.warnings


@pytest.mark.parametrize(
    ("data", "image"),
    [
        ({"img": "001.png", "text": "a room", "width": 64}, "001.png"),
        ({"url": "https://example.org/frame_000001"}, "/frame_000001"),
        ({"image": "frame_000001", "thumbnail": "small.png"}, "frame_000001"),
        ({"a": "1.png", "b": "2.png"}, None),
        ({"a": 1}, None),
    ],
)
def test_any_data_field_may_name_the_image(tmp_path: Path, data: dict[str, Any], image: str | None) -> None:
    tasks = [task(1, "", polygon("r", "wall", square(0, 0, 9, 9)))]
    tasks[0]["data"] = data
    if image is None:
        with pytest.raises(
            GtlayoutError, match=r"none of its data fields, or more than one, names an image \(1, first"
        ):
            read(tmp_path, tasks)
    else:
        assert read(tmp_path, tasks).key_frames[0].image == image


def test_several_images_in_a_task(tmp_path: Path) -> None:
    results = [*polygon("a", "wall", square(0, 0, 9, 9)), *polygon("b", "floor", square(0, 9, 9, 20))]
    for item, result in enumerate(results):
        result["item_index"] = item
    tasks = [task(1, "", results)]
    tasks[0]["data"] = {"images": ["001.png", "002.png"]}
    raw = read(tmp_path, tasks)
    assert [(k.image, [s.label for s in k.shapes]) for k in raw.key_frames] == [
        ("001.png", ["wall"]),
        ("002.png", ["floor"]),
    ]


def test_what_belongs_to_what(tmp_path: Path) -> None:
    box = square(0, 0, 9, 9)
    wall, floor = polygon("r1", "wall", box, id="w"), polygon("r2", "floor", box)
    by_text = polygon("r3", "visible", box, element="w")
    related, related_back = polygon("r4", "visible", box), polygon("r5", "visible", box)
    below, by_note = polygon("r6", "visible", box), polygon("r7", "visible", box)
    below[0]["parentID"] = "r1"
    by_note[0]["meta"] = {"text": ["rough. element: r2"]}
    relations: list[dict[str, Any]] = [
        {"type": "relation", "from_id": "r4", "to_id": "r5", "direction": "right"},
        {"type": "relation", "from_id": "r4", "to_id": "r1", "direction": "right"},
        {"type": "relation", "from_id": "r2", "to_id": "r5", "direction": "bi", "labels": ["visible part of"]},
        {"type": "relation", "from_id": "r2", "to_id": "gone"},
    ]
    found = shapes(tmp_path, [*relations, *wall, *floor, *by_text, *related, *related_back, *below, *by_note])
    assert [s.id for s in found[:2]] == ["w", "r2"]
    assert [(s.label, s.element) for s in found[2:]] == [("visible", e) for e in ("w", "w", "r2", "w", "r2")]


def test_labels_may_be_results_of_their_own(tmp_path: Path) -> None:
    value: dict[str, Any] = {"points": percent(square(0, 0, 10, 10))}
    common = {"original_width": 64, "original_height": 48, "to_name": "image"}
    results: list[dict[str, Any]] = [
        {**common, "id": "a", "type": "polygon", "value": value},
        {**common, "id": "a", "type": "labels", "value": {**value, "labels": ["wall"]}},
        {**common, "id": "b", "type": "polygon", "value": value},
        {**common, "id": "b", "type": "choices", "value": {**value, "choices": ["floor"]}},
        {**common, "id": "c", "type": "polygonlabels", "value": {**value, "polygonlabels": ["door", "visible"]}},
        {"id": "d", "type": "choices", "from_name": "quality", "value": {"choices": ["good"]}},
    ]
    found = shapes(tmp_path, results)
    assert [(s.label, s.id, s.element) for s in found] == [
        ("wall", "a", None),
        ("floor", "b", None),
        ("door", "c", "c"),
        ("visible", "c", "c"),
    ]
    assert all(area_px2(shape) == pytest.approx(100) for shape in found)


def test_a_rectangle_turns_about_its_corner_in_pixels(tmp_path: Path) -> None:
    size = (1000, 500)
    value = {"x": 20.0, "y": 20.0, "width": 30.0, "height": 20.0, "rotation": 90}
    results = region("r", value, size, kind="rectanglelabels", label="wall")
    np.testing.assert_allclose(
        shapes(tmp_path, results)[0].polygons[0], [(200, 100), (200, 400), (100, 400), (100, 100)], atol=1e-9
    )


def vertices(points_px: list[Point], **more: Any) -> list[dict[str, Any]]:
    return [{"x": x, "y": y, **more} for x, y in percent(points_px)]


def vector(value: dict[str, Any], label: str = "occlusion_edge") -> list[dict[str, Any]]:
    return region("v", value, SIZE, kind="vectorlabels", label=label)


def test_vectors_are_lines_or_when_closed_polygons(tmp_path: Path) -> None:
    corners = square(0, 0, 32, 24)
    (line,) = shapes(tmp_path, vector({"vertices": vertices(corners)}))
    np.testing.assert_allclose(line.lines, [corners])
    assert line.polygons == ()
    (ring,) = shapes(tmp_path, vector({"vertices": vertices(corners), "closed": True}, "wall"))
    np.testing.assert_allclose(ring.polygons, [corners])
    assert ring.lines == ()


def linked(points_px: list[Point], previous: list[int | None]) -> list[dict[str, Any]]:
    names = ["a", "b", "c", "d"]
    return [
        {**vertex, "id": own, "prevPointId": None if before is None else names[before]}
        for vertex, own, before in zip(vertices(points_px), names, previous, strict=True)
    ]


def test_vertices_follow_the_one_they_name(tmp_path: Path) -> None:
    a, c, d, b = points = [(0.0, 0.0), (32.0, 24.0), (0.0, 24.0), (32.0, 0.0)]
    for first in (None, 2):  # An open path has a beginning; a ring need not have one.
        late = linked(points, [first, 3, 1, 0])
        (ring,) = shapes(tmp_path, vector({"vertices": late, "closed": True}, "wall"))
        np.testing.assert_allclose(ring.polygons, [[a, b, c, d]])
    (tree,) = shapes(tmp_path, vector({"vertices": linked(points, [None, 0, 1, 0])}))
    assert [line.tolist() for line in tree.lines] == [[list(p) for p in path] for path in ([a, c, d], [a, b])]


def test_curves_are_straight_with_a_warning(tmp_path: Path) -> None:
    curved = vertices([(0, 0), (32, 24)], isBezier=True, controlPoint1={"x": 1, "y": 2}, controlPoint2={"x": 3, "y": 4})
    raw = read(tmp_path, [task(1, "001.png", vector({"vertices": curved}))])
    np.testing.assert_allclose(raw.key_frames[0].shapes[0].lines, [[(0, 0), (32, 24)]])
    assert raw.warnings == ("project-1.json: curved vector read as straight between its points (1, first in 001.png)",)


def test_a_square_is_the_same_square_drawn_or_painted(tmp_path: Path) -> None:
    corners = square(10, 20, 30, 45)
    drawn = polygon("p", "wall", corners)
    mask = np.zeros((48, 64), dtype=bool)
    mask[20:45, 10:30] = True
    runs = [(True, 3, [255 * int(value)] * 4) for value in mask.ravel()]
    painted = region("b", {"format": "rle", "rle": [*pack(runs, 4 * 48 * 64)]}, SIZE, kind="brushlabels", label="wall")
    box = {"x": 10 / 0.64, "y": 20 / 0.48, "width": 20 / 0.64, "height": 25 / 0.48, "rotation": 0}
    boxed = region("r", box, SIZE, kind="rectanglelabels", label="wall")
    closed = vector({"vertices": vertices(corners), "closed": True}, "wall")
    for shape in shapes(tmp_path, [*drawn, *painted, *boxed, *closed]):
        (ring,) = shape.polygons
        assert (Polygon(ring) ^ Polygon(corners)).area < 1e-9


def test_which_annotation_counts(tmp_path: Path) -> None:
    labels = ("wall", "floor", "door", "window", "ceiling")
    results = [polygon("r", label, square(0, 0, 9, 9)) for label in labels]
    annotations: list[dict[str, Any]] = [{"result": result} for result in results]
    first, last, cancelled, skipped, gold = annotations
    first["updated_at"], last["updated_at"] = "2025-03-09T22:16:08Z", "2025-03-10T08:00:00Z"
    cancelled["was_cancelled"] = skipped["skipped"] = True
    gold["ground_truth"] = True

    def counts(**task_fields: Any) -> tuple[list[str], tuple[str, ...]]:
        raw = read(tmp_path, [{"data": {"image": "001.png"}, **task_fields}])
        return [shape.label for shape in raw.key_frames[0].shapes], raw.warnings

    assert counts(completions=[first]) == (["wall"], ())
    several = "task annotated more than once: its ground truth, else what was updated last, counts"
    last["id"] = 12
    assert counts(annotations=[last, first, cancelled, skipped]) == (
        ["floor"],
        (
            f"project-1.json: {several} (1, first in task 1, where annotation 12 does)",
            "project-1.json: task has other annotations, which are left out: they are cancelled or broken "
            "(1, first in task 1)",
        ),
    )
    assert counts(annotations=[gold, last])[0] == ["ceiling"]
    left_out = "task has predictions, which are left out: they count when submitted as annotations (1, first in task 1)"
    assert counts(annotations=[first], predictions=[last]) == (["wall"], (f"project-1.json: {left_out}",))
    with pytest.raises(GtlayoutError, match=r"no annotated image among 1 tasks \(task has predictions, which are left"):
        counts(annotations=[], predictions=[first])
    with pytest.raises(GtlayoutError, match="cancelled"):
        counts(annotations=[cancelled])


def test_what_is_broken_is_skipped_and_counted(tmp_path: Path) -> None:
    good = polygon("g", "wall", square(0, 0, 9, 9))
    value = {"points": percent(square(0, 0, 9, 9))}
    broken: list[Any] = [
        *region("a", {"points": [[1, 2], [3]]}, SIZE, kind="polygonlabels", label="wall"),
        *region("b", {"points": [[1, 2], [3, float("nan")]]}, SIZE, kind="polygonlabels", label="wall"),
        *region("c", {"points": []}, SIZE, kind="polygonlabels", label="wall"),
        *region("d", {"x": 1, "y": 2, "radiusX": 3, "radiusY": 4}, SIZE, kind="ellipselabels", label="wall"),
        *region("e", {"rle": [256]}, SIZE, kind="brushlabels", label="wall"),
        {"id": "f", "type": "polygon", "value": value},
        "g",
    ]
    other_size = polygon("h", "wall", square(0, 0, 9, 9))
    del other_size[0]["original_width"]
    alone = read(tmp_path, [task(1, "001.png", [*broken, *good, *other_size]), 7, task(2, "002.png", other_size)])
    assert [len(k.shapes) for k in alone.key_frames] == [2, 0]  # The size is the image's: one result tells it.
    assert [line.removeprefix("project-1.json: ") for line in alone.warnings] == [
        "result skipped: it is no object (1, first in 001.png)",
        "region skipped: a point is not [x, y] in percent (2, first in 001.png)",
        "region skipped: it has no points (1, first in 001.png)",
        "region skipped: it is of type ellipse, not polygon, brush, vector or rectangle (1, first in 001.png)",
        "region skipped: its mask is no list of bytes (1, first in 001.png)",
        "region skipped: it has no label (1, first in 001.png)",
        "task skipped: it is no object (1, first in task 2)",
        "region skipped: original_width and original_height are missing (1, first in 002.png)",
    ]


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("keypointlabels", {"x": 46.2, "y": 41.1, "width": 30.0, "height": 30.0}),  # a box by its keys alone
        ("keypoint", {"x": 46.2, "y": 41.1, "width": 30.0, "height": 30.0}),
        ("ellipselabels", {"x": 46.2, "y": 41.1, "radiusX": 3.0, "radiusY": 4.0}),
        ("videorectangle", {"x": 46.2, "y": 41.1, "width": 30.0, "height": 30.0}),
        ("bitmasklabels", {"imageDataURL": "data:image/png;base64,AAAA", "width": 9, "height": 9}),
    ],
)
@pytest.mark.parametrize("flat", [False, True], ids=["JSON", "JSON-MIN"])
def test_regions_of_other_types_are_left_out(tmp_path: Path, kind: str, value: dict[str, Any], flat: bool) -> None:
    good, other = polygon("g", "wall", square(0, 0, 9, 9)), region("k", value, SIZE, kind=kind, label="wall")
    tasks: list[Any] = [task(1, "001.png", [*good, *other, *region("l", value, SIZE, kind=kind, label="wall")])]
    if flat and kind.endswith("labels"):  # else its labels do not tell what it is
        sizes = {"original_width": SIZE[0], "original_height": SIZE[1]}
        results = tasks[0]["annotations"][0]["result"]
        tasks = [{"image": "001.png", "id": 1, "label": [{**result["value"], **sizes} for result in results]}]
    raw = read(tmp_path, tasks)
    assert [shape.label for shape in raw.key_frames[0].shapes] == ["wall"]
    assert area_px2(raw.key_frames[0].shapes[0]) == pytest.approx(81)
    what = f"it is of type {kind.removesuffix('labels')}, not polygon, brush, vector or rectangle"
    assert [line for line in raw.warnings if f"region skipped: {what} (2, first in 001.png)" in line]


def test_a_type_without_its_geometry_is_left_out(tmp_path: Path) -> None:
    box = {"x": 1, "y": 2, "width": 3, "height": 4}
    line = {"points": percent(square(0, 0, 9, 9)), "closed": False}  # as early vectors were
    broken = [
        *region("a", box, SIZE, kind="polygonlabels", label="wall"),
        *region("b", line, SIZE, kind="vectorlabels", label="occlusion_edge"),
    ]
    raw = read(tmp_path, [task(1, "001.png", broken)])
    assert raw.key_frames[0].shapes == ()
    assert raw.warnings == (
        "project-1.json: region skipped: it lacks the geometry of a polygon, brush, vector or rectangle "
        "(2, first in 001.png)",
    )


def test_labels_of_a_tag_of_their_own(tmp_path: Path) -> None:
    common = {"id": "r", "original_width": SIZE[0], "original_height": SIZE[1]}
    value = {"points": percent(square(0, 0, 9, 9))}
    results = [
        {**common, "type": "polygon", "value": value},
        {**common, "type": "labels", "value": {**value, "labels": ["wall"]}},
    ]
    (wall,) = shapes(tmp_path, results)
    assert wall.label == "wall"
    assert area_px2(wall) == pytest.approx(81)


def test_what_is_not_about_images_or_regions_is_said(tmp_path: Path) -> None:
    good = polygon("g", "wall", square(0, 0, 9, 9))
    text = task(2, "What a long story. " * 40, [{"id": "t", "type": "choices", "value": {"choices": ["good"]}}])
    raw = read(tmp_path, [task(1, "001.png", [*good, {"type": "relation", "from_id": "g"}]), text])
    assert [k.image for k in raw.key_frames] == ["001.png"]
    assert raw.warnings == (
        "project-1.json: relation skipped: it does not name two regions (1, first in 001.png)",
        "project-1.json: task skipped: it is about no image (1, first in task 2)",
    )


def test_drafts_are_left_out(tmp_path: Path) -> None:
    good = task(1, "001.png", polygon("g", "wall", square(0, 0, 9, 9)))
    raw = read(tmp_path, [{**good, "drafts": [{"result": []}]}])
    assert [line for line in raw.warnings if "task has drafts, which are left out" in line]


def test_nothing_annotated_is_an_error(tmp_path: Path) -> None:
    nothing: list[Any] = [[], {}, [1], "x", None]
    for tasks in nothing:
        with pytest.raises(GtlayoutError, match=r"project-1\.json"):
            read(tmp_path, tasks)


# ---- with Label Studio's own converter ----


def test_turned_rectangles_as_the_real_tool_has_them(tmp_path: Path) -> None:
    values = [{"x": 30.5, "y": 20.25, "width": 21, "height": 33, "rotation": r} for r in (0, 12.5, 90, 200, 359)]
    said = [{**value, "original_width": 64, "original_height": 48} for value in values]
    (tmp_path / "in.json").write_text(json.dumps(said))
    run_tool("make_label_studio.py", "obb", str(tmp_path / "in.json"), str(tmp_path / "out.json"))
    for value, corners in zip(values, json.loads((tmp_path / "out.json").read_text()), strict=True):
        (wall,) = shapes(tmp_path, region("r", value, SIZE, kind="rectanglelabels", label="wall"))
        np.testing.assert_allclose(wall.polygons[0], corners, atol=1e-9)


def coco(points_px: list[FloatArray]) -> dict[str, Any]:
    annotations = [
        {"id": i, "image_id": 1, "category_id": 1, "segmentation": [points.ravel().tolist()], "iscrowd": 0}
        for i, points in enumerate(points_px)
    ]
    image = {"id": 1, "file_name": "room 1/001.png", "width": 64, "height": 48}
    return {"images": [image], "categories": [{"id": 1, "name": "wall"}], "annotations": annotations}


def test_a_file_the_real_tool_made_from_coco(tmp_path: Path) -> None:
    drawn = [np.random.default_rng(i).uniform(0, 48, (5, 2)) for i in range(3)]
    (tmp_path / "coco.json").write_text(json.dumps(coco(drawn)))
    run_tool("make_label_studio.py", "import", str(tmp_path / "coco.json"), str(tmp_path / "ls.json"))
    raw = read_label_studio(tmp_path, tmp_path / "ls.json")
    (key_frame,) = raw.key_frames
    assert (key_frame.image, key_frame.image_size, raw.warnings) == ("room 1/001.png", SIZE, ())
    for shape, points in zip(key_frame.shapes, drawn, strict=True):
        assert shape.label == "wall"
        np.testing.assert_allclose(shape.polygons[0], points, atol=1e-9)


def test_the_real_tool_reads_the_same_pixels(tiny: Path) -> None:
    scene = load_scene(tiny)
    tasks = label_studio_json(scene.frames, scene.key_frames)
    out = tiny / "out"
    out.mkdir()
    (out / "tasks.json").write_text(json.dumps(tasks))
    run_tool("make_label_studio.py", "export", str(out / "tasks.json"), CONFIG, str(out))
    theirs = json.loads((out / "coco/result.json").read_text())
    ours = read_label_studio(out, out / "tasks.json").key_frames
    rings = [np.reshape(a["segmentation"][0], (-1, 2)) for a in theirs["annotations"]]
    for ring, shape in zip(rings, [s for k in ours for s in k.shapes], strict=True):
        np.testing.assert_allclose(shape.polygons[0], ring, atol=1e-9)
    minimal = read_label_studio(out, out / "min/result.json")
    assert [k.image for k in minimal.key_frames] == [k.image for k in ours]
    for got, expected in zip(minimal.key_frames, ours, strict=True):
        assert [(s.label, s.id) for s in got.shapes] == [(s.label, None) for s in expected.shapes]
        for one, other in zip(got.shapes, expected.shapes, strict=True):
            np.testing.assert_allclose(one.polygons, other.polygons)
    (warning,) = minimal.warnings
    assert "JSON-MIN task: what belongs to what is lost" in warning
    (tiny / "annotations.json").unlink()
    (tiny / "min.json").write_bytes((out / "min/result.json").read_bytes())
    assert load_scene(tiny).key_frames[0].elements[0].visible.area == pytest.approx(312.5)
