"""Where annotations lie and how they are told: any encoding and order of keys, zips, files that are named."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import warnings
import zipfile
from pathlib import Path
from typing import Any

import pytest

from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import WINDOW, kinds_in, left_out
from gtlayout.io.annotations.foreign import Foreign
from gtlayout.io.archives import members, read_bytes
from gtlayout.io.scene_folder import load_scene
from gtlayout.limits import FILE_MB

SQUARE = [[0, 0], [40, 0], [40, 30], [0, 30]]
XML = (
    '<image id="0" name="001.png" width="64" height="48"><polygon label="wall" points="0,0;40,0;40,30;0,30"/></image>'
    '<image id="1" name="003.png" width="64" height="48"><polygon label="wall" points="0,0;40,0;40,30;0,30"/></image>'
)
CVAT = f"<annotations><version>1.1</version>{XML}</annotations>"
COCO: dict[str, Any] = {
    "images": [{"id": i, "file_name": f"{i:03d}.png", "width": 64, "height": 48} for i in (1, 3)],
    "categories": [{"id": 1, "name": "wall"}],
    "annotations": [
        {"id": i, "image_id": i, "category_id": 1, "segmentation": [[0, 0, 40, 0, 40, 30, 0, 30]]} for i in (1, 3)
    ],
}
LABELME: dict[str, Any] = {
    "version": "5.5.0",
    "flags": {},
    "shapes": [{"label": "wall", "points": SQUARE, "shape_type": "polygon"}],
    "imagePath": "001.png",
    "imageData": None,
    "imageHeight": 48,
    "imageWidth": 64,
}
TASKS = [
    {
        "id": i,
        "data": {"image": f"{i:03d}.png"},
        "annotations": [
            {
                "result": [
                    {
                        "id": "a",
                        "type": "polygonlabels",
                        "original_width": 64,
                        "original_height": 48,
                        "value": {"points": [[0, 0], [62.5, 0], [62.5, 62.5], [0, 62.5]], "polygonlabels": ["wall"]},
                    }
                ]
            }
        ],
    }
    for i in (1, 3)
]


@pytest.fixture
def bare(tiny: Path) -> Path:
    """The scene without annotations."""
    (tiny / "annotations.json").unlink()
    return tiny


def _areas(root: Path, annotations: Path | None = None) -> dict[str, float]:
    scene = load_scene(root, annotations)
    return {scene.frames[k.frame].name: k.elements[0].amodal.area for k in scene.key_frames}


def _zip(path: Path, **files: Any) -> Path:
    """With ``__`` for a slash and ``_`` for the dot before the ending."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as content:
        for name, data in files.items():
            parts, ending = name.replace("__", "/").rsplit("_", 1)
            content.writestr(f"{parts}.{ending}", data if isinstance(data, str | bytes) else json.dumps(data))
    return path


BOTH = {"001.png": 1200.0, "003.png": 1200.0}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32"])
@pytest.mark.parametrize("ending", ["json", "JSON"])
@pytest.mark.parametrize("data", [COCO, TASKS], ids=["coco", "label-studio"])
def test_json_in_any_encoding(bare: Path, data: Any, encoding: str, ending: str) -> None:
    (bare / f"export.{ending}").write_bytes(f"\r\n {json.dumps(data)}\n\n".encode(encoding))
    assert _areas(bare) == BOTH


@pytest.mark.parametrize(
    "content",
    [
        CVAT.encode("utf-8-sig"),
        f'<?xml version="1.0" encoding="utf-16"?>{CVAT}'.encode("utf-16"),
        f'<?xml version="1.0"?>\n<!-- by <annotation> hand -->\r\n<!-- > -->{CVAT}'.encode(),
        CVAT.replace(">", ">\n   ").encode(),
    ],
    ids=["mark", "utf-16", "comments", "pretty"],
)
def test_cvat_in_any_encoding(bare: Path, content: bytes) -> None:
    (bare / "JOB.XML").write_bytes(content)
    assert _areas(bare) == BOTH


def test_cameras_with_a_byte_order_mark(tiny: Path) -> None:
    path = tiny / "transforms.json"
    path.write_bytes(path.read_text().encode("utf-8-sig"))
    assert len(load_scene(tiny).frames) == 5


def _with_first(key: str, value: Any, data: dict[str, Any]) -> dict[str, Any]:
    return {key: value, **{k: v for k, v in data.items() if k != key}}


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (_with_first("imageData", "A" * 3_000_000, LABELME), "labelme"),
        (_with_first("notes", "A" * 3_000_000, LABELME), "labelme"),
        ({"frames": ["A" * (WINDOW - 32)], "format": "gtlayout-annotations/1"}, "native"),  # across two windows
        (_with_first("info", {"description": "A" * 200_000}, COCO), "coco"),
        (
            {"annotations": [{"segmentation": {"counts": [1] * 100_000, "size": [9, 9]}, "image_id": 1}]},
            "coco",
        ),
        ([{"id": 1, "meta": "A" * 200_000, **TASKS[0]}], "label-studio"),
        ({"image_size": None, "frames": ["A" * 200_000], "format": "gtlayout-annotations/1"}, "native"),
        ({"frames": ["A" * 200_000], "camera_model": "OPENCV"}, None),
    ],
)
def test_what_tells_a_file_may_stand_anywhere(tmp_path: Path, data: Any, kind: str | None) -> None:
    (tmp_path / "some.json").write_text(json.dumps(data))
    assert list(kinds_in(tmp_path).values()) == ([] if kind is None else [kind])


def test_an_image_before_the_shapes_is_read(bare: Path) -> None:
    (bare / "images/001.json").write_text(json.dumps(_with_first("imageData", "A" * 3_000_000, LABELME)))
    assert _areas(bare) == {"001.png": 1200.0}


@pytest.mark.parametrize(
    "files",
    [
        {"annotations_xml": CVAT, "images__001_png": b"an image"},
        {"annotations__instances_default_json": COCO, "images__001_png": b"an image"},
        {"project-1-at-2025-03-09_json": TASKS},
        {"set__001_json": LABELME, "other set__003_json": {**LABELME, "imagePath": "003.png"}},
        {"__MACOSX__._annotations_xml": b"\0\5\x16", "._annotations_xml": b"\0\5", "annotations_xml": CVAT},
        {"deep\\windows\\annotations_xml": CVAT},
    ],
    ids=["cvat", "coco", "label-studio", "labelme", "macos", "windows"],
)
@pytest.mark.parametrize("named", [True, False])
def test_zips_are_opened(bare: Path, tmp_path_factory: pytest.TempPathFactory, files: Any, named: bool) -> None:
    folder = tmp_path_factory.mktemp("downloads") if named else bare
    before = set(bare.rglob("*"))
    archive = _zip(folder / "export.zip", **files)
    assert _areas(bare, archive if named else None) == BOTH
    assert set(bare.rglob("*")) - before <= {archive}, "nothing is unpacked"


def test_a_zip_needs_no_ending_and_a_file_in_it_can_be_named(bare: Path, tmp_path: Path) -> None:
    archive = _zip(bare / "download", a__train_json=COCO, a__val_json={**COCO, "images": COCO["images"][:1]})
    assert _areas(bare, archive / "a/val.json") == {"001.png": 1200.0}
    with pytest.raises(GtlayoutError, match=r"more than one place: .*a/train\.json.*a/val\.json"):
        load_scene(bare, archive)
    with pytest.raises(GtlayoutError, match=r"no annotations .*other\.json"):
        load_scene(bare, archive / "other.json")


def test_labels_beside_a_zip_count(bare: Path) -> None:
    archive = _zip(bare / "export.zip", annotations_xml=CVAT.replace('"wall"', '"Wand"'))
    (bare / "labels.json").write_text('{"Wand": "wall"}')
    for named in (None, archive, archive / "annotations.xml"):
        assert _areas(bare, named) == BOTH


def test_a_zip_beside_what_was_unpacked_from_it_stays_shut(tiny: Path) -> None:
    _zip(tiny / "export.zip", annotations_xml=CVAT)
    scene = load_scene(tiny)
    assert scene.key_frames[0].elements[0].amodal.area == 64 * 48
    assert "export.zip was not opened: annotations lie beside it" in scene.warnings


BACKUP = [{"version": 0, "tags": [], "shapes": [{"type": "polygon", "points": [0, 0], "label": "wall"}], "tracks": []}]
WEB = "<annotation><filename>1.jpg</filename><source><sourceImage/></source><object><polygon/></object></annotation>"
VOC = "<annotation><filename>1.jpg</filename><object><name>wall</name><bndbox/></object></annotation>"
DATUMARO = {"info": {}, "categories": {"label": {"labels": []}}, "items": []}
VIA = {"_via_settings": {}, "_via_img_metadata": {"a": {"filename": "1.jpg", "regions": [], "file_attributes": {}}}}
CREATE_ML = [{"image": "1.jpg", "annotations": [{"label": "wall", "coordinates": {"x": 1, "y": 2}}]}]
CLOUD_TASK = {"id": 1, "result": [], "completed_by": {"id": 1}, "task": {"data": {"image": "1.jpg"}}}
SUPERVISELY = {"description": "", "size": {"height": 1, "width": 1}, "objects": [{"classTitle": "wall"}]}


@pytest.mark.parametrize(
    ("files", "says"),
    [
        (
            {"task_json": {"name": "t"}, "annotations_json": BACKUP},
            "annotations.json: a backup of a CVAT task, not read",
        ),
        ({"default__1_xml": WEB, "default__2_xml": WEB}, "1.xml and 1 more: XML of the LabelMe web tool, not read"),
        ({"Annotations__1_xml": VOC}, "1.xml: Pascal VOC's XML"),
        (
            {"annotations__default_json": DATUMARO},
            "default.json: Datumaro's JSON, not read; export as CVAT for images 1.1",
        ),
        ({"via_json": VIA}, "via.json: a project of the VGG Image Annotator, not read"),
        ({"1_json": CREATE_ML}, "CreateML's JSON"),
        ({"1_json": CLOUD_TASK}, "a single task of Label Studio"),
        ({"1_json": SUPERVISELY}, "Supervisely's JSON"),
        ({"data_yaml": "names: []", "labels__1_txt": "0 1 1 1"}, "export.zip: YOLO's text files, not read"),
        ({"labelmap_txt": "", "SegmentationClass__1_png": b""}, "export.zip: segmentation masks, not read"),
        ({"gt__gt_txt": "1,1,1"}, "export.zip: MOT's text files"),
        ({"images__1_png": b"an image"}, "export.zip holds no annotations"),
    ],
)
def test_other_formats_are_refused_by_name(bare: Path, files: Any, says: str) -> None:
    archive = _zip(bare / "export.zip", **files)
    for named in (archive, None):
        with pytest.raises(GtlayoutError) as caught:
            load_scene(bare, named)
        assert says in str(caught.value)
        assert str(named or bare) in str(caught.value)
    scene = load_scene(bare, annotated=False)
    assert [line for line in scene.warnings if says in line], "an import without annotations goes on and says it"


def test_other_formats_beside_annotations_are_said(tiny: Path) -> None:
    (tiny / "voc.xml").write_text(VOC)
    scene = load_scene(tiny)
    assert len(scene.key_frames) == 2
    assert [line for line in scene.warnings if line.startswith("voc.xml: Pascal VOC's XML")]


def test_files_that_are_named_are_read_or_refused(bare: Path, tmp_path: Path) -> None:
    text = bare / "annotations.txt"
    text.write_text("no annotations")
    for named in (text, bare / "transforms.json", bare / "images/001.png", bare / "images"):
        for annotated in (True, False):
            with pytest.raises(GtlayoutError, match=rf"no annotations in .*{named.name}"):
                load_scene(bare, named, annotated=annotated)
    text.write_text(CVAT)
    assert _areas(bare, text) == BOTH, "told by its content"
    (bare / "labelme").mkdir()
    for image in ("001", "003"):
        (bare / f"labelme/{image}.json").write_text(json.dumps({**LABELME, "imagePath": f"{image}.png"}))
    assert _areas(bare, bare / "labelme") == BOTH
    assert _areas(bare, bare / "labelme/003.json") == {"003.png": 1200.0}


def test_import_opens_what_it_is_given(bare: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    archive, out = _zip(bare / "cvat_export.zip", annotations_xml=CVAT), tmp_path / "out"
    assert main(["import", str(bare), str(out), "--annotations", str(archive)]) == 0
    assert "not annotated yet" not in capsys.readouterr().out
    assert _areas(out) == BOTH
    (bare / "notes.txt").write_text("no annotations")
    refused = tmp_path / "refused"
    assert main(["import", str(bare), str(refused), "--annotations", str(bare / "notes.txt")]) == 1
    assert "notes.txt is no file of a known tool" in capsys.readouterr().err
    assert not refused.exists()


def test_names_in_a_zip_lead_nowhere(tmp_path: Path) -> None:
    outside = tmp_path / "secret.xml"
    outside.write_text(CVAT)
    (tmp_path / "in").mkdir()
    archive = tmp_path / "in/export.zip"
    with zipfile.ZipFile(archive, "w") as content:
        for name in ("../secret.xml", "a/../../secret.xml", "/secret.xml", "x" * 2000 + ".xml", "of\\windows.xml"):
            content.writestr(name, "<annotations/>")
    assert members(archive) == [archive / "of/windows.xml", archive / "secret.xml"]
    assert read_bytes(archive / "secret.xml") == b"<annotations/>"
    with pytest.raises(GtlayoutError, match=r"no such file in export\.zip"):
        read_bytes(archive / "../secret.xml/x")


def test_a_zip_that_unpacks_to_too_much_is_refused(bare: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    archive = _zip(bare / "export.zip", annotations_xml=CVAT + " " * 1_000_000)
    assert _areas(bare) == BOTH
    monkeypatch.setenv(FILE_MB.variable, "1")
    with pytest.raises(GtlayoutError, match=r"export\.zip.*: more than 1 MB: set GTLAYOUT_MAX_FILE_MB"):
        load_scene(bare, archive)


@pytest.mark.parametrize("at", [0, 30, 60, -30])
def test_damaged_zips(bare: Path, at: int) -> None:
    archive = _zip(bare / "export.zip", annotations_xml=CVAT)
    content = bytearray(archive.read_bytes())
    content[at : at + 12 if at >= 0 else None] = b"\xff" * len(content[at : at + 12 if at >= 0 else None])
    archive.write_bytes(content)
    for named in (archive, None):
        with pytest.raises(GtlayoutError) as caught:
            load_scene(bare, named)
        assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("compression", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_damage_within_a_file_of_a_zip_is_said_whatever_its_compression(tmp_path: Path, compression: int) -> None:
    archive = tmp_path / "export.zip"
    with zipfile.ZipFile(archive, "w", compression) as content:
        content.writestr("annotations.xml", CVAT * 20)
    assert read_bytes(archive / "annotations.xml") == (CVAT * 20).encode()
    damaged = bytearray(archive.read_bytes())
    damaged[70:100] = b"\xff" * 30
    archive.write_bytes(damaged)
    with pytest.raises(GtlayoutError, match=r"cannot read .*export\.zip"):
        read_bytes(archive / "annotations.xml")


def test_a_locked_zip(bare: Path) -> None:
    archive = _zip(bare / "export.zip", annotations_xml=CVAT)
    content = bytearray(archive.read_bytes())
    content[6] |= 1
    content[content.rindex(b"PK\1\2") + 8] |= 1
    archive.write_bytes(content)
    for named in (archive, None):
        with pytest.raises(GtlayoutError, match=r"annotations\.xml: cannot read .*export\.zip: .*password required"):
            load_scene(bare, named)


def test_a_damaged_file_in_a_zip_costs_only_itself(bare: Path) -> None:
    with zipfile.ZipFile(bare / "export.zip", "w") as content:
        for image in ("001", "003"):
            content.writestr(f"{image}.json", json.dumps({**LABELME, "imagePath": f"{image}.png"}))
    damaged = (bare / "export.zip").read_bytes().replace(b'"imagePath": "003.png"', b'"imagePath": "004.png"')
    (bare / "export.zip").write_bytes(damaged)
    scene = load_scene(bare)
    assert [scene.frames[k.frame].name for k in scene.key_frames] == ["001.png"]
    (line,) = [line for line in scene.warnings if "003.json" in line]
    assert "Bad CRC-32" in line


def test_nothing_to_say_of_a_readable_place(bare: Path) -> None:
    (bare / "export.json").write_text(json.dumps(COCO))
    assert left_out(bare) == []
    assert not any(isinstance(kind, Foreign) for kind in kinds_in(bare).values())


def test_the_module_is_the_command() -> None:
    command = [sys.executable, "-m", "gtlayout"]
    root = Path(__file__).parents[1]
    shown = subprocess.run([*command, "--help"], capture_output=True, text=True, check=False, cwd=root)
    assert shown.returncode == 0
    assert shown.stdout.startswith("Usage: gtlayout COMMAND")
    failed = subprocess.run([*command, "check", "nowhere"], capture_output=True, text=True, check=False, cwd=root)
    assert (failed.returncode, failed.stderr) == (1, "gtlayout: no scene folder nowhere\n")


def test_files_are_closed(bare: Path) -> None:
    (bare / "export.json").write_text(json.dumps(COCO))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert kinds_in(bare)
        gc.collect()
    assert said == []
