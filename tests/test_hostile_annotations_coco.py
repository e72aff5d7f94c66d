"""COCO, LabelMe, native and CAD-Estate annotations, whatever stands in them: one clear error or warnings."""

from __future__ import annotations

import base64
import copy
import json
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations import labelme, native
from gtlayout.io.annotations.coco import reader as coco
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.masks import PNG_HEAD, decode_mask, mask_polygons
from gtlayout.io.cad_estate.reader import read_masks
from gtlayout.io.cad_estate.room_structure import read_room_structure
from gtlayout.io.files import write_atomic
from gtlayout.io.sources import RawAnnotations, Reader
from gtlayout.limits import FILE_MB
from gtlayout.scene import Camera, Frame

few = settings(derandomize=True, deadline=None, max_examples=60)
CAMERA = Camera(np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]), np.eye(3), np.zeros(3), 64, 48)
FRAMES = [Frame(f"00{i}.png", Path("nowhere"), CAMERA) for i in (1, 2)]
SQUARE = [[1, 2], [30, 2], [30, 40], [1, 40]]
FLAT = [v for point in SQUARE for v in point]
RLE = {"size": [48, 64], "counts": [100, 40, 64 * 48 - 140]}
PACKED = {"size": [48, 64], "counts": "T3X1dk2"}


def _png(width: int, height: int, pixels: bytes) -> bytes:
    """A grey PNG that says it is so large, whatever it holds."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return PNG_HEAD[:8] + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b"")


def _base64(png: bytes) -> str:
    return base64.b64encode(png).decode()


MASK = {"label": "wall", "points": [[3, 4], [4, 5]], "shape_type": "mask", "mask": _base64(_png(2, 2, b"\0\1\1\0\1\1"))}
FORMATS: dict[str, tuple[Reader[RawAnnotations], str, dict[str, Any]]] = {
    "coco": (
        coco.READER,
        "coco.json",
        {
            "images": [{"id": i, "file_name": f"00{i}.png", "width": 64, "height": 48} for i in (1, 2)],
            "annotations": [
                {"id": 1, "image_id": 1, "category_id": 1, "segmentation": [FLAT, FLAT], "attributes": {"id": "a"}},
                {"id": 2, "image_id": 1, "category_id": 2, "segmentation": RLE, "attributes": {"element": "a"}},
                {
                    "id": 3,
                    "image_id": 2,
                    "category_id": 1,
                    "segmentation": RLE,
                    "inmodal_seg": PACKED,
                },
                {"id": 4, "image_id": 2, "regions": [{"name": "floor", "segmentation": FLAT, "visible_mask": RLE}]},
            ],
            "categories": [{"id": 1, "name": "wall"}, {"id": 2, "name": "visible"}],
        },
    ),
    "labelme": (
        labelme.READER,
        "001.json",
        {
            "shapes": [
                {"label": "wall", "points": SQUARE, "shape_type": "polygon", "group_id": 1, "description": "id=a"},
                {"label": "visible", "points": [[3, 3], [20, 20]], "shape_type": "rectangle", "group_id": 1},
                {"label": "occlusion_edge", "points": SQUARE, "shape_type": "linestrip"},
                MASK,
            ],
            "imagePath": "001.png",
            "imageWidth": 64,
            "imageHeight": 48,
        },
    ),
    "native": (
        native.READER,
        "annotations.json",
        {
            "format": "gtlayout-annotations/1",
            "image_size": [64, 48],
            "frames": [
                {
                    "image": "001.png",
                    "elements": [
                        {"id": "a", "label": "wall", "polygons": [SQUARE, SQUARE], "visible": [SQUARE]},
                        {"id": 2, "label": "door", "polygons": [SQUARE]},
                    ],
                    "occlusion_edges": [SQUARE],
                }
            ],
        },
    ),
}
every_format = pytest.mark.parametrize("kind", FORMATS)
hostile_values = st.one_of(
    st.sampled_from(
        [None, True, "", "../../etc/passwd", "/etc/passwd", "C:\\x", "link.png", "a\nb\x1b[31m", "\ud800", "wall"]
    ),
    st.sampled_from([-1, 0, 1, 10**9, 10**400, -(2**63), 1e308, float("inf"), float("nan"), 0.5]),
    st.sampled_from([[], {}, [[]], [[[[]]]], [{}], {"size": [60_000, 60_000], "counts": [0, 3_600_000_000]}, [0] * 6]),
    st.sampled_from([_base64(_png(60_000, 60_000, b"")), _base64(_png(2, 2, b"")), _base64(b"\x89PNG"), "a" * 5000]),
    st.text(max_size=5),
    st.recursive(st.integers() | st.floats(), lambda inner: st.lists(inner, max_size=3), max_leaves=8),
)


@pytest.fixture(scope="module")
def opened() -> Iterator[Callable[[], list[str]]]:
    """What was opened since it was asked last."""
    names: list[str] = []
    listening = True

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if listening and event == "open" and isinstance(arguments[0], str):
            names.append(arguments[0])

    def since() -> list[str]:
        found = list(names)
        names.clear()
        return found

    sys.addaudithook(hook)  # there is no way to remove it
    yield since
    listening = False


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile")
    (folder / "link.png").symlink_to("/etc/passwd")
    return folder


def _read(kind: str, folder: Path, content: bytes) -> RawAnnotations | None:
    """What is read, all of it used; None when it is refused in one line that names the file or folder."""
    reader, file_name, _ = FORMATS[kind]
    path = folder / file_name
    path.write_bytes(content)
    try:
        reader.detect(folder)
        read = reader.read(folder, folder if kind == "labelme" else path)
    except GtlayoutError as error:
        assert str(folder) in str(error)
        _is_one_line(str(error))
        return None
    try:
        _, warnings = build_key_frames(read, FRAMES, (), {})
    except GtlayoutError as error:
        warnings = [str(error)]
    for line in (*read.warnings, *warnings):
        _is_one_line(line)
    return read


def _is_one_line(text: str) -> None:
    assert text.isprintable(), repr(text)
    text.encode()


def _places(value: Any, here: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [here, *(place for key, each in inner for place in _places(each, (*here, key)))]


def _replaced(data: Any, place: tuple[Any, ...], value: Any) -> Any:
    if not place:
        return value
    data = copy.copy(data)
    data[place[0]] = _replaced(data[place[0]], place[1:], value)
    return data


@every_format
def test_the_valid_file_is_read(kind: str, folder: Path) -> None:
    read = _read(kind, folder, json.dumps(FORMATS[kind][2]).encode())
    assert read is not None
    assert not any("dropped" in line for line in read.warnings)


@every_format
@few
@given(data=st.data())
def test_wrong_values(kind: str, folder: Path, opened: Callable[[], list[str]], data: st.DataObject) -> None:
    content = FORMATS[kind][2]
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.sampled_from(_places(content)))
        content = _replaced(content, place, data.draw(hostile_values))
    text = json.dumps(content).encode()
    opened()
    _read(kind, folder, text)
    assert {Path(name).parent for name in opened()} == {folder}


@every_format
@few
@given(data=st.data())
def test_damaged_bytes(kind: str, folder: Path, data: st.DataObject) -> None:
    text = json.dumps(FORMATS[kind][2]).encode()
    start, stop = sorted(data.draw(st.tuples(*[st.integers(0, len(text))] * 2)))
    _read(
        kind, folder, text[:start] + data.draw(st.sampled_from([b"", b"\xff\xfe", b"\0", b"[", b'{"a":'])) + text[stop:]
    )


@every_format
@pytest.mark.parametrize("content", [b"", b"null", b"[]", b"{}", b"[" * 100_000, b'{"a":' * 100_000, b"\xef\xbb\xbf{}"])
def test_no_such_file(kind: str, folder: Path, content: bytes) -> None:
    reader, file_name, _ = FORMATS[kind]
    (folder / file_name).write_bytes(content)
    with pytest.raises(GtlayoutError, match=folder.name if kind == "labelme" else file_name):
        reader.read(folder, folder if kind == "labelme" else folder / file_name)


def test_masks_are_not_unpacked_before_their_size_is_known(folder: Path) -> None:
    huge = {**MASK, "mask": _base64(_png(60_000, 60_000, b"")), "points": [[0, 0], [59_999, 59_999]]}
    read = _read("labelme", folder, json.dumps({**FORMATS["labelme"][2], "shapes": [MASK, huge]}).encode())
    assert read is not None
    assert "claims to have more than" in read.warnings[0]
    long_chunk = bytearray(_png(2, 2, b"\0\1\1\0\1\1"))
    long_chunk[33] = 0x80  # the image data's length
    with pytest.raises(ValueError, match="damaged"):
        decode_mask(bytes(long_chunk))
    noise = np.indices((1100, 1100)).sum(axis=0) % 2 > 0
    with pytest.raises(ValueError, match="noise"):
        mask_polygons(noise)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The annotations of a CAD-Estate clip with one mask of 6x4 px."""
    folder = tmp_path_factory.mktemp("cad_estate")
    rows = b"".join(b"\0" + bytes([0, 1, 1, 2, 2, 2]) for _ in range(4))
    for kind in ("structure", "visible"):
        write_atomic(folder / f"structure_annotations/processed_{kind}_video_33333.png", _png(6, 4, rows))
    np.savez_compressed(
        folder / "room_structure.npz",
        clip_name=np.array("video_0"),
        layout_triangles=np.zeros((2, 3, 3), np.float32),
        layout_triangle_flags=np.zeros(2, np.int64),
        layout_num_tri=np.array([0, 1, 1]),
        layout_labels=np.array([0, 1, 2]),
        annotated_timestamps=np.array([33333]),
    )
    return folder


def _damaged(content: bytes, data: st.DataObject) -> bytes:
    if data.draw(st.booleans()):
        return content[: data.draw(st.integers(0, len(content) - 1))]
    changed = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        changed[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    return bytes(changed)


@few
@given(data=st.data())
def test_damaged_room_structure(clip: Path, data: st.DataObject) -> None:
    path = clip / "room_structure.npz"
    content = path.read_bytes()
    bad = clip / "bad.npz"
    bad.write_bytes(_damaged(content, data))
    try:
        read_room_structure(bad)
    except GtlayoutError as error:
        assert str(bad) in str(error)
        _is_one_line(str(error))


@few
@given(data=st.data())
def test_damaged_cad_estate_masks(clip: Path, data: st.DataObject) -> None:
    masks = clip / "structure_annotations"
    mask = data.draw(st.sampled_from(sorted(masks.glob("*.png"))))
    content = mask.read_bytes()
    mask.write_bytes(_damaged(content, data))
    try:
        read_masks(clip, masks)
    except GtlayoutError as error:
        assert str(masks) in str(error)
        _is_one_line(str(error))
    finally:
        mask.write_bytes(content)


def test_room_structure_that_claims_too_much(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = dict(np.load(clip / "room_structure.npz"))
    bomb = tmp_path / "room_structure.npz"
    np.savez_compressed(bomb, **{**parts, "layout_triangles": np.zeros((30_000, 3, 3), np.float32)})
    monkeypatch.setenv(FILE_MB.variable, "1")
    with pytest.raises(GtlayoutError, match=r"room_structure\.npz: more than 1 MB: set GTLAYOUT_MAX_FILE_MB"):
        read_room_structure(bomb)
    np.savez(bomb, **parts)
    bomb.write_bytes(bomb.read_bytes().replace(b"(2, 3, 3), }" + b" " * 14, b"(999999999999999, 3, 3), } "[:26]))
    with pytest.raises(GtlayoutError, match=r"room_structure\.npz"):
        read_room_structure(bomb)
