"""COCO: files of Datumaro and pycocotools, amodal variants, run lengths, what is dropped, round trip."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pycocotools import mask as coco_masks
from pycocotools.coco import COCO
from scene_checks import assert_same_drawings
from shapely import MultiPolygon, Polygon
from tools_env import run_tool

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.coco.reader import READER, read_coco, write_coco
from gtlayout.io.annotations.coco.rle import decompressed, rle_rings
from gtlayout.io.files import write_json_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.sources import RawShape
from gtlayout.scene import BoolArray, Element, KeyFrame

pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # pycocotools'
SQUARE = [10, 20, 30, 20, 30, 40, 10, 40]
BOX = shapely.box(10, 20, 30, 40)


def _file(tmp_path: Path, *annotations: Any, **parts: Any) -> Path:
    data = {
        "images": [{"id": 1, "file_name": "001.png", "width": 64, "height": 48}],
        "annotations": annotations,
        "categories": [{"id": 1, "name": "wall"}, {"id": 2, "name": "visible"}],
        **parts,
    }
    path = tmp_path / "coco.json"
    write_json_atomic(path, data)
    return path


def _shapes(tmp_path: Path, *annotations: Any, **parts: Any) -> tuple[RawShape, ...]:
    read = read_coco(tmp_path, _file(tmp_path, *annotations, **parts))
    assert len(read.warnings) == 1
    return read.key_frames[0].shapes


def _region(rings: Any) -> Any:
    return shapely.union_all([Polygon(ring) for ring in rings])


def _annotation(**fields: Any) -> dict[str, Any]:
    return {"id": 5, "image_id": 1, "category_id": 1, **fields}


def _rle(mask: BoolArray) -> tuple[dict[str, Any], dict[str, Any]]:
    """Compressed and plain, as pycocotools makes them."""
    packed = coco_masks.encode(np.asfortranarray(mask.astype(np.uint8)))
    flat = np.concatenate([[False], mask.ravel(order="F")])
    runs = np.diff(np.concatenate([[0], np.flatnonzero(flat[1:] != flat[:-1]), [mask.size]]))
    counts = runs.tolist()
    return {"size": packed["size"], "counts": packed["counts"].decode()}, {"size": packed["size"], "counts": counts}


def test_a_file_of_datumaro(tmp_path: Path) -> None:
    run_tool("make_coco.py", str(tmp_path))
    (path,) = READER.detect(tmp_path)
    read = read_coco(tmp_path, path)
    assert path.name == "instances_default.json"
    assert [(k.image, k.image_size) for k in read.key_frames] == [
        ("a/000001.jpg", (30, 20)),
        ("a/000002.jpg", (30, 20)),
    ]
    wall, floor, visible = read.key_frames[0].shapes
    assert (wall.label, wall.id, wall.element) == ("Wall", "west", None)
    assert [p.tolist() for p in wall.polygons] == [
        [[0, 0], [10, 0], [10, 12.5], [0, 12.5]],
        [[20, 0], [30, 0], [30, 10]],
    ]
    assert (floor.label, floor.id, floor.visible) == ("Floor", "7", ())
    assert (visible.label, visible.id, visible.element) == ("visible", None, "west")
    (mask,) = read.key_frames[1].shapes
    assert _region(mask.polygons).equals(shapely.box(10, 5, 25, 15) - shapely.box(14, 8, 20, 11))
    assert read.warnings == (f"{path}: COCO has no occlusion edges, so neighbours are taken to touch everywhere",)


def test_what_is_written_is_read_by_pycocotools_and_datumaro(tmp_path: Path, tiny: Path) -> None:
    holed = MultiPolygon([shapely.box(5, 5, 45, 35) - shapely.box(10, 10, 20.5, 20), shapely.box(50, 0, 60, 5)])
    element = Element("east", "wall", holed, MultiPolygon([BOX]))
    frames = load_scene(tiny).frames
    path = tmp_path / "out/annotations/instances_default.json"
    write_coco(path, frames, (KeyFrame(3, (element,)),))
    with contextlib.redirect_stdout(io.StringIO()):
        coco = COCO(path)
    (image,) = coco.loadImgs(coco.getImgIds())
    assert (image["file_name"], image["width"], image["height"]) == (frames[3].name, 64, 48)
    amodal, visible = coco.loadAnns(coco.getAnnIds())
    assert coco.loadCats([amodal["category_id"], visible["category_id"]])[1]["name"] == "visible"
    assert (amodal["area"], amodal["bbox"]) == (holed.area, [5, 0, 55, 35])
    mask = coco.annToMask(amodal)
    assert abs(mask.sum() - holed.area) <= 10  # half a column of pixels
    assert not mask[11:20, 11:20].any()
    (tmp_path / "out/images").mkdir()
    read = json.loads(run_tool("read_coco.py", str(tmp_path / "out")))
    assert {(image, label, json.dumps(attributes)) for image, label, _, attributes in read} == {
        ("003", "wall", '{"id": "east"}'),
        ("003", "visible", '{"element": "east"}'),
    }
    rings = [np.reshape(points, (-1, 2)) for _, label, points, _ in read if label == "wall"]
    assert _region(rings).symmetric_difference(holed).area == pytest.approx(0, abs=1e-9)


def test_a_square_is_the_same_as_polygon_and_as_mask(tmp_path: Path) -> None:
    drawn = coco_masks.decode(coco_masks.frPyObjects([SQUARE], 48, 64))[:, :, 0].astype(bool)
    for segmentation in ([SQUARE], SQUARE, *_rle(drawn)):
        (shape,) = _shapes(tmp_path, _annotation(segmentation=segmentation))
        assert _region(shape.polygons).equals(BOX)


@pytest.mark.parametrize("seed", range(6))
def test_run_lengths_of_pycocotools(seed: int) -> None:
    rng = np.random.default_rng(seed)
    coarse = rng.random((int(rng.integers(1, 30)), int(rng.integers(1, 30)))) < rng.choice([0.1, 0.5, 0.95])
    mask = np.kron(coarse, np.ones((3, 3))) > 0  # no stairs of one pixel, which outlines smooth
    packed, plain = _rle(mask)
    assert decompressed(packed["counts"]) == plain["counts"]
    row, column = np.nonzero(mask)
    pixels = shapely.union_all(shapely.box(column, row, column + 1, row + 1))
    for rle in (packed, plain):
        assert _region(rle_rings(rle, mask.shape[::-1])).equals(pixels)


def test_a_mask_costs_what_its_runs_cost() -> None:
    side = 60_000
    tracemalloc.start()
    (ring,) = rle_rings({"size": [side, side], "counts": [side // 2, side * side - side // 2]}, None)
    assert Polygon(ring).area == side * side - side // 2
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak_bytes < 1 << 20


def test_amodal_variants(tmp_path: Path) -> None:
    mask = np.zeros((48, 64), dtype=bool)
    mask[25:30, 12:20] = True
    seen = [12, 25, 20, 25, 20, 30, 12, 30]
    part = shapely.box(12, 25, 20, 30)
    kins = _annotation(segmentation=[SQUARE], inmodal_seg=_rle(mask)[0])
    old_kins = _annotation(a_segm=[SQUARE], i_segm=[seen])
    d2sa = _annotation(segmentation=_rle(mask)[1], visible_mask=_rle(mask)[0])
    for annotation, amodal in ((kins, BOX), (old_kins, BOX), (d2sa, part)):
        (shape,) = _shapes(tmp_path, annotation)
        assert _region(shape.polygons).equals(amodal)
        assert _region(shape.visible).equals(part)
    (modal,) = _shapes(tmp_path, _annotation(segmentation=[SQUARE]))
    assert modal.visible == ()
    hidden = {"name": "wall", "segmentation": SQUARE, "visible_mask": _rle(mask)[0], "invisible_mask": _rle(~mask)[0]}
    free = {"name": "floor", "segmentation": SQUARE}
    cocoa = {"id": 9, "image_id": 1, "regions": [hidden, free]}
    read = _shapes(tmp_path, cocoa, categories=[])
    assert [
        (shape.label, _region(shape.visible).equals(whole)) for shape, whole in zip(read, (part, BOX), strict=True)
    ] == [
        ("wall", True),
        ("floor", True),
    ]


def test_ids_tie_parts_and_visible_parts(tiny: Path) -> None:
    (tiny / "annotations.json").unlink()
    other = [40, 0, 60, 0, 60, 20, 40, 20]
    _file(
        tiny,
        _annotation(segmentation=[SQUARE], attributes={"ID": 3.0}),
        _annotation(segmentation=[other], attributes={"id": "3"}),
        _annotation(segmentation=[other], category_id=2, attributes={"element": "3", "id": ""}),
        _annotation(segmentation=[SQUARE], category_id=2, attributes=None),
    )
    (key_frame,) = load_scene(tiny).key_frames
    (element,) = key_frame.elements
    assert (element.id, element.amodal.area, element.visible.area) == ("3", 800, 800)


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (_annotation(keypoints=[1, 2, 3], num_keypoints=1), "it has no segmentation"),
        ({"id": 5, "image_id": 1, "caption": "a wall"}, "its category is none of the file's"),
        (_annotation(segmentation=[SQUARE], category_id=77), "its category is none of the file's"),
        (_annotation(segmentation=[SQUARE], image_id=77), "its image is none of the file's"),
        (_annotation(segmentation=[SQUARE], image_id=[1]), "its image is none of the file's"),
        (_annotation(segmentation=[SQUARE[:5]]), "points are no pairs of finite numbers"),
        (_annotation(segmentation=[["1", "2", "3", "4", "5", "6"]]), "points are no pairs"),
        (_annotation(segmentation=[[1e300] * 6]), "points are no pairs"),
        (_annotation(segmentation="all of it"), "neither polygons nor a mask"),
        (_annotation(segmentation={"counts": "abc"}), "its mask has no size"),
        (_annotation(segmentation={"size": [10**9, 10**9], "counts": [10**18]}), "its mask has no size"),
        (_annotation(segmentation={"size": [64, 48], "counts": [64 * 48]}), "another size than its image"),
        (_annotation(segmentation={"size": [48, 64], "counts": [64 * 47]}), "do not add up to its size"),
        (_annotation(segmentation={"size": [48, 64], "counts": [-1, 64 * 48 + 1]}), "no counts of pixels"),
        (_annotation(segmentation={"size": [48, 64], "counts": "a b"}), "runs are damaged"),
        (_annotation(segmentation={"size": [48, 64], "counts": "o" * 50}), "runs are damaged"),
        (_annotation(segmentation={"size": [48, 64], "counts": "o"}), "runs are cut off"),
        ("annotation", "annotation skipped: it is no object"),
        ({"image_id": 1, "regions": [3]}, "its region is none"),
    ],
)
def test_what_is_dropped(tmp_path: Path, bad: Any, says: str) -> None:
    good = _annotation(segmentation=[SQUARE])
    read = read_coco(tmp_path, _file(tmp_path, bad, good, bad))
    assert len(read.key_frames[0].shapes) == 1
    assert len(read.warnings) == 2
    assert says in read.warnings[1]
    assert "(2, first in" in read.warnings[1]
    with pytest.raises(GtlayoutError, match=r"coco\.json: no annotation can be used"):
        read_coco(tmp_path, _file(tmp_path, bad))


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"images": None}, "images must be a list"),
        ({"annotations": {}}, "annotations must be a list"),
        ({"categories": 3}, "categories must be a list"),
        ({"annotations": []}, r"no annotation can be used \(it has none\)"),
    ],
)
def test_what_is_refused(tmp_path: Path, parts: Any, says: str) -> None:
    with pytest.raises(GtlayoutError, match=rf"coco\.json: {says}"):
        read_coco(tmp_path, _file(tmp_path, **parts))


def test_of_two_images_with_one_id_the_first_counts(tmp_path: Path) -> None:
    images = [{"id": 1, "file_name": f"{i}.png", "width": 64, "height": 48} for i in "ab"]
    read = read_coco(tmp_path, _file(tmp_path, _annotation(segmentation=[SQUARE]), images=images))
    assert [k.image for k in read.key_frames] == ["a.png"]
    assert read.warnings[1:] == ("coco.json: image skipped: another has its id (1, first in b.png)",)


def test_images_without_size_and_out_of_the_folder(tiny: Path) -> None:
    (tiny / "annotations.json").unlink()
    images = [
        {"id": "x", "file_name": "images\\001.png", "width": 0, "height": 0},
        {"id": 2, "file_name": "../../etc/passwd", "width": 64, "height": 48},
        {"id": 3},
    ]
    annotations = [_annotation(segmentation=[SQUARE], image_id=i) for i in ("x", 2)]
    _file(tiny, *annotations, images=images)
    scene = load_scene(tiny)
    assert [scene.frames[k.frame].name for k in scene.key_frames] == ["001.png"]
    assert scene.warnings[1:3] == (
        "coco.json: image skipped: it has no id or no file_name (1, first in images)",
        "coco.json: annotated image ../../etc/passwd has no camera",
    )


def test_files_are_found_whatever_comes_first(tmp_path: Path) -> None:
    images = [{"id": i, "file_name": f"{i:06d}.jpg", "width": 64, "height": 48} for i in range(2000)]
    path = tmp_path / "instances.json"
    path.write_text(json.dumps({"info": {}, "images": images, "annotations": [], "categories": []}))
    assert READER.detect(tmp_path) == [path]
    path.write_text(json.dumps({"annotations": [{"image_id": 3, "regions": []}], "images": images}))
    assert READER.detect(tmp_path) == [path]


def test_round_trip_of_a_room(room: Path, tmp_path: Path) -> None:
    scene = load_scene(room)
    copy = tmp_path / "room"
    shutil.copytree(room, copy)
    (copy / "annotations.json").unlink()
    write_coco(copy / "instances.json", scene.frames, scene.key_frames)
    again = load_scene(copy)
    assert [w for w in again.warnings if w not in scene.warnings] == [
        f"{copy / 'instances.json'}: COCO has no occlusion edges, so neighbours are taken to touch everywhere"
    ]
    assert_same_drawings(scene, again)
