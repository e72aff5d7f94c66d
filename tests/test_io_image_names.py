"""Names of images as tools and systems spell them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from gtlayout.io.cameras.colmap.reader import write_colmap
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.io.image_names import FilesOnDisk, NameIndex, NameMatch, parts_of, path_of_address
from gtlayout.io.scene_folder import load_scene

COMPOSED, DECOMPOSED = "K\u00fcche.jpg", "Ku\u0308che.jpg"


@pytest.mark.parametrize(
    ("address", "path"),
    [
        ("/data/upload/3/1a2b3c4d-000030.jpg", "/data/upload/3/1a2b3c4d-000030.jpg"),
        ("http://localhost:8080/data/upload/3/1a2b3c4d-a%20b.jpg", "/data/upload/3/1a2b3c4d-a b.jpg"),
        ("/data/local-files/?d=images/000030.jpg", "images/000030.jpg"),
        ("/data/local-files?d=room%201/000030.jpg", "room 1/000030.jpg"),
        ("http://localhost:8080/data/local-files/?x=1&d=room%2F1.jpg", "room/1.jpg"),
        ("s3://bucket/room/000030%20.jpg", "/room/000030%20.jpg"),
        ("https://example.org/room/a%20b.jpg?X-Amz-Date=1#here", "/room/a b.jpg"),
        ("C:\\rooms\\000030.jpg", "C:\\rooms\\000030.jpg"),
        ("images/000030.jpg", "images/000030.jpg"),
        ("data/room #1/a%20b.jpg", "data/room #1/a%20b.jpg"),
        ("1a2b3c4d-000030.jpg", "1a2b3c4d-000030.jpg"),
        ("http://[/1.jpg", "http://[/1.jpg"),
    ],
)
def test_paths_in_addresses(address: str, path: str) -> None:
    assert path_of_address(address) == path


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("a/b/1.jpg", ("a", "b", "1.jpg")),
        ("/a//b/./1.jpg", ("a", "b", "1.jpg")),
        ("a\\b\\1.jpg", ("a", "b", "1.jpg")),
        ("C:\\a\\1.jpg", ("a", "1.jpg")),
        ("../../a/x/../1.jpg", ("a", "1.jpg")),
        ("a b.jpg", ("a b.jpg",)),
        ("/", ()),
        ("", ()),
        (" ", ()),
    ],
)
def test_parts_of_paths(name: str, parts: tuple[str, ...]) -> None:
    assert parts_of(name) == parts


@pytest.mark.parametrize(
    ("there", "wanted", "exact"),
    [
        (COMPOSED, DECOMPOSED, True),
        (DECOMPOSED, COMPOSED, True),
        ("IMG_1.JPG", "img_1.jpg", False),
        ("000030.jpg", "000030", False),
        ("000030.jpg", "30", False),
        ("30.jpg", "000030.png", False),
        ("frame_000030.jpg", "frame_30", False),
        ("a.b.jpg", "a.b", False),
        ("scan (0).jpg", "scan_(0).jpg", False),
        ("scan (0).jpg", "scan%20(0).jpg", True),
        ("scan%20(0).jpg", "scan (0).jpg", True),
        ("scan (0).jpg", "ab12cd34-scan_0.jpg", False),
        ("a(b)c.jpg", "ab12cd34-abc.jpg", False),
        ("ab12cd34-scan_0.jpg", "scan (0).jpg", False),
        ("scan (0).jpg", "/data/local-files/?d=dir%2Fscan%20(0).jpg", True),
        ("scan 0.jpg", "https://host/x/ab12cd34-scan_0.jpg?sig=1", False),
        (COMPOSED, "ab12cd34-Ku\u0308che.jpg", True),
        ("scan.png", "scan_png.rf.0123456789abcdef0123456789abcdef.jpg", True),
        ("scan (1).jpg", "scan-1-_jpg.rf.AbC0123.jpg", False),
        ("scan_jpg.rf.0123456789abcdef.jpg", "scan.jpg", True),
        ("scan.jpg", "scan.jpg.png", True),
        ("2024-01-02.jpg", "2024_01_02", False),
    ],
)
def test_one_image_by_two_names(there: str, wanted: str, *, exact: bool) -> None:
    names = NameIndex(["other.jpg", there, "third.jpg"])
    found = names.find(wanted)
    assert found is not None
    assert found == NameMatch((1,), exact, other_folder=False)


@pytest.mark.parametrize(
    ("there", "wanted"),
    [
        ("1 10.jpg", "11 0.jpg"),
        ("scan.jpg", "scan2.jpg"),
        ("abcdefgh-1.jpg", "1.jpg"),
        ("20240101-0001.jpg", "20240102-0001.jpg"),
        ("().jpg", "[].jpg"),
        ("1.jpg", ""),
        ("1.jpg", "/"),
    ],
)
def test_two_images(there: str, wanted: str) -> None:
    assert NameIndex([there]).find(wanted) is None


def test_the_better_spelling_goes_first() -> None:
    names = [COMPOSED, DECOMPOSED, "a.JPG", "a.jpg", "a b.jpg", "a_b.jpg", "1.jpg", "01.jpg", "ab12cd34-1.png", "a.png"]
    index = NameIndex(names)
    for place, name in enumerate(names):
        assert index.find(name) == NameMatch((place,), exact=True, other_folder=False)
    several = index.find("A.Jpg")
    assert several is not None
    assert several.places == (2, 3)


@pytest.mark.parametrize(
    ("wanted", "places", "other_folder"),
    [
        ("a/b/1.jpg", (0,), False),
        ("room/images/a/b/1.jpg", (0,), False),
        ("b/1.jpg", (1,), False),
        ("z/b/1.jpg", (1,), False),
        ("a\\.\\b\\1.jpg", (0,), False),
        ("c d/1.jpg", (2,), False),
        ("c_d/1.JPG", (2,), False),
        ("1.jpg", (3,), False),
        ("z/1.jpg", (3,), False),
        ("z/2.jpg", (4,), True),
        ("2.jpg", (4,), False),
        ("z/3.jpg", (5, 6), True),
        ("3.jpg", (5, 6), False),
    ],
)
def test_the_longest_common_folders_decide(wanted: str, places: tuple[int, ...], *, other_folder: bool) -> None:
    names = ["a/b/1.jpg", "b/1.jpg", "c d/1.jpg", "1.jpg", "a/2.jpg", "a/3.jpg", "b/3.jpg"]
    found = NameIndex(names).find(wanted)
    assert found is not None
    assert (found.places, found.other_folder) == (places, other_folder)


def test_files_are_found_as_the_disk_spells_them(tmp_path: Path) -> None:
    folder = tmp_path / "Fo\u0308n 1"
    folder.mkdir()
    for name in (DECOMPOSED, "1.JPG", "a b.jpg", "a_b.jpg", "2.jpg.json", "ab12cd34-3.jpg", "4.png"):
        (folder / name).touch()
    files, wanted = FilesOnDisk(), tmp_path / "F\u00f6n 1"
    assert files.find(wanted / COMPOSED) == folder / DECOMPOSED
    assert files.find(wanted / "1.jpg") == folder / "1.JPG"
    assert files.find(folder / "a b.jpg") == folder / "a b.jpg"
    for name in ("a-b.jpg", "2.jpg", "3.jpg", "4.jpg", "4", ""):
        assert files.find(wanted / name) is None, name
    assert files.find(tmp_path / "none/1.jpg") is None


@pytest.mark.parametrize("with_size", [True, False])
def test_cameras_find_images_that_the_disk_spells_otherwise(tiny: Path, *, with_size: bool) -> None:
    before = load_scene(tiny)
    data = read_json(tiny / "transforms.json")
    spelled = [(f"images/Stra\u00dfe {i} \u00e4.png", f"Stra\u00dfe_{i} a\u0308.PNG") for i in range(5)]
    for i, (in_file, on_disk) in enumerate(spelled):
        (tiny / f"images/{i:03d}.png").rename(tiny / "images" / on_disk)
        data["frames"][i]["file_path"] = in_file
    if not with_size:
        data = {key: value for key, value in data.items() if key not in ("w", "h")}
    write_json_atomic(tiny / "transforms.json", data)
    annotations = read_json(tiny / "annotations.json")
    for key_frame, i in zip(annotations["frames"], (1, 3), strict=True):
        key_frame["image"] = f"stra\u00dfe {i} \u00e4"
    write_json_atomic(tiny / "annotations.json", annotations)
    scene = load_scene(tiny)
    assert [frame.image_path.name for frame in scene.frames] == [on_disk for _, on_disk in spelled]
    assert [key_frame.frame for key_frame in scene.key_frames] == [1, 3]
    assert scene.warnings == before.warnings


@pytest.mark.parametrize("folder", ["images", "."])
def test_colmaps_names_find_files_that_the_disk_spells_otherwise(tiny: Path, folder: str) -> None:
    scene = load_scene(tiny)
    (tiny / "transforms.json").unlink()
    write_colmap(
        tiny / "sparse/0", [replace(f, name=f"K\u00fcche {i}.png") for i, f in enumerate(scene.frames)], binary=True
    )
    for i in range(5):
        (tiny / f"images/{i:03d}.png").rename(tiny / folder / f"Ku\u0308che_{i:03d}.PNG")
    annotations = read_json(tiny / "annotations.json")
    annotations["frames"][0]["image"] = "9f8e7d6c-Ku\u0308che_1.png"
    annotations["frames"][1]["image"] = "Ku\u0308che_003.PNG"
    write_json_atomic(tiny / "annotations.json", annotations)
    again = load_scene(tiny)
    assert [frame.name for frame in again.frames] == [f"K\u00fcche {i}.png" for i in range(5)]
    assert [key_frame.frame for key_frame in again.key_frames] == [1, 3]
    assert again.warnings == scene.warnings


def test_a_file_of_another_camera_is_not_taken(tiny: Path) -> None:
    data = read_json(tiny / "transforms.json")
    (tiny / "images/004.png").unlink()
    data["frames"][4]["file_path"] = "images/003 .png"
    write_json_atomic(tiny / "transforms.json", data)
    scene = load_scene(tiny)
    assert [frame.name for frame in scene.frames] == ["000.png", "001.png", "002.png", "003.png"]
    assert scene.warnings == (f"1 of 5 cameras have no image file and were skipped, first {tiny / 'images/003 .png'}",)


def test_a_file_that_two_cameras_could_mean_is_neithers(tmp_path: Path) -> None:
    (tmp_path / "a b.png").touch()
    (tmp_path / "c.png").touch()
    wanted = [[tmp_path / name] for name in ("A B.png", "a_b.png", "c.png", "C.png", "d.png")]
    assert FilesOnDisk().find_each(wanted) == [None, None, tmp_path / "c.png", None, None]
