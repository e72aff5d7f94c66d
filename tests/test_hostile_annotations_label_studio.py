"""Broken and hostile Label Studio files: one error of one line that names the file, or warnings; nothing else."""

from __future__ import annotations

import copy
import json
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from label_studio_writer import pack, region, task
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.label_studio.reader import read_label_studio
from gtlayout.scene import Camera, Frame, KeyFrame

SIZE = (8, 6)
FRAMES = [
    Frame(name, Path(name), Camera(np.diag([8.0, 8.0, 1.0]), np.eye(3), np.zeros(3), *SIZE))
    for name in ("1.png", "2.png")
]
BOX = [[0, 0], [50, 0], [50, 100], [0, 100]]
MASK = [*pack([(True, 3, [0] * 100), (True, 3, [255] * 92)], 192)]
HOSTILE = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 300),
    st.sampled_from([10**30, 10**400, -(10**30), 1e308, float("nan"), float("inf"), 2**31, 99_999_999]),
    st.sampled_from(["", "\x00", "../../etc/passwd", "/etc/passwd", "a\nb\x1b[2J", "\ud800", "x" * 100_000, "$image"]),
    st.sampled_from(
        ["http://[", "file:///etc/passwd", "/data/local-files/?d=../../x", "s3://", "C:\\x.png", "p1", "v1"]
    ),
    st.sampled_from([[], {}, [[]], [{}], {"id": {}}, [[1, 2]] * 3, {"rle": [1] * 9}, {"points": 3}, [0] * 5000]),
)
QUICK = settings(
    max_examples=60, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def valid() -> list[dict[str, Any]]:
    vertices = [{"id": str(i), "prevPointId": str(i - 1), "x": 9 * i, "y": 9 * i, "isBezier": i > 2} for i in range(4)]
    box = {"x": 5, "y": 5, "width": 30, "height": 20, "rotation": 15}
    results = [
        *region("p1", {"points": BOX}, SIZE, kind="polygonlabels", label="wall", id="w", element="w"),
        *region("v1", {"vertices": vertices, "closed": False}, SIZE, kind="vectorlabels", label="occlusion_edge"),
        *region("b1", {"format": "rle", "rle": MASK}, SIZE, kind="brushlabels", label="visible"),
        *region("r1", box, SIZE, kind="rectanglelabels", label="door"),
        {"type": "relation", "from_id": "b1", "to_id": "p1", "direction": "right"},
    ]
    results[0]["meta"], results[0]["parentID"], results[0]["item_index"] = {"text": ["element: w"]}, "r1", 0
    return [task(1, "/data/upload/3/1a2b3c4d-1.png", results), task(2, "2.png", copy.deepcopy(results))]


def understood(path: Path) -> tuple[KeyFrame, ...]:
    """Read the file; whatever is wrong must have been said on one line."""
    try:
        raw = read_label_studio(path.parent, path)
        key_frames, warnings = build_key_frames(raw, FRAMES, (), {})
    except GtlayoutError as error:
        assert str(path) in str(error)
        assert str(error).isprintable()
        return ()
    assert all(line.isprintable() for line in (*raw.warnings, *warnings))
    assert all(isinstance(e.amodal, MultiPolygon) and e.amodal.is_valid for k in key_frames for e in k.elements)
    return key_frames


def places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every (container, key) in the data."""
    for key in data if isinstance(data, dict) else range(len(data)):
        yield data, key
        if isinstance(data[key], dict | list):
            yield from places(data[key])


def test_the_file_to_be_broken_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "ls.json"
    path.write_text(json.dumps(valid()))
    raw = read_label_studio(tmp_path, path)
    assert [line.split(": ")[1].split(" (")[0] for line in raw.warnings] == [
        "curved vector read as straight between its points"
    ]
    assert [len(k.elements) for k in understood(path)] == [2, 2]


@QUICK
@given(changes=st.lists(st.tuples(st.integers(0, 10**6), HOSTILE), min_size=1, max_size=4))
def test_anything_anywhere(tmp_path: Path, changes: list[tuple[int, Any]]) -> None:
    tasks = valid()
    for where, value in changes:
        found = list(places(tasks))
        container, key = found[where % len(found)]
        container[key] = copy.deepcopy(value)
    path = tmp_path / "ls.json"
    path.write_text(json.dumps(tasks))
    understood(path)


@QUICK
@given(place=st.integers(0, 10**6))
def test_keys_may_be_missing(tmp_path: Path, place: int) -> None:
    tasks = valid()
    found = list(places(tasks))
    container, key = found[place % len(found)]
    del container[key]
    path = tmp_path / "ls.json"
    path.write_text(json.dumps(tasks))
    assert understood(path)  # One thing missing spoils one image at most.


@QUICK
@given(data=st.binary(max_size=300))
def test_random_bytes(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "ls.json"
    path.write_bytes(data)
    assert understood(path) == ()


@QUICK
@given(rle=st.lists(st.integers(0, 255), max_size=60))
def test_random_masks(tmp_path: Path, rle: list[int]) -> None:
    tasks = valid()
    tasks[0]["annotations"][0]["result"][5]["value"]["rle"] = [0, 0, 0, 192, *rle]
    path = tmp_path / "ls.json"
    path.write_text(json.dumps(tasks))
    assert understood(path)


def test_truncated_files(tmp_path: Path) -> None:
    text = json.dumps(valid())
    path = tmp_path / "ls.json"
    for length in range(0, len(text), 211):
        path.write_text(text[:length])
        assert understood(path) == ()


@pytest.mark.parametrize("text", ["[" * 100_000, '[{"data":' * 50_000, "[" + "9" * 5000 + "]", "", "\ufeff[]", "[{}]"])
def test_deep_and_odd_files(tmp_path: Path, text: str) -> None:
    path = tmp_path / "ls.json"
    path.write_text(text)
    assert understood(path) == ()


def test_a_folder_or_nothing_in_its_place(tmp_path: Path) -> None:
    (tmp_path / "ls.json").mkdir()
    for name in ("ls.json", "absent.json"):
        assert understood(tmp_path / name) == ()


@pytest.mark.parametrize("size", [(10**6, 10**6), (9999, 9999), (0, 6), (-8, 6), (8.5, 6), (1e300, 1)])
def test_sizes_in_a_file_reserve_nothing(tmp_path: Path, size: tuple[int, int]) -> None:
    tasks = [task(1, "1.png", region("b", {"rle": MASK}, size, kind="brushlabels", label="wall"))]
    path = tmp_path / "ls.json"
    path.write_text(json.dumps(tasks))
    tracemalloc.start()
    with suppress(GtlayoutError):
        understood(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10e6


def test_nothing_is_opened_but_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [
        "/etc/passwd",
        "../../1.png",
        "file:///etc/passwd",
        "/data/local-files/?d=/etc/passwd",
        "http://host/1.png",
    ]
    box = region("p", {"points": BOX}, SIZE, kind="polygonlabels", label="wall")
    path = tmp_path / "ls.json"
    path.write_text(json.dumps([task(i, name, box) for i, name in enumerate(names)]))
    opened: list[Path] = []
    really: Callable[..., Any] = Path.open

    def noted(self: Path, *args: Any, **kwargs: Any) -> Any:
        opened.append(self)
        return really(self, *args, **kwargs)

    monkeypatch.setattr(Path, "open", noted)
    assert [k.image for k in read_label_studio(tmp_path, path).key_frames] == [
        "/etc/passwd",
        "../../1.png",
        "/etc/passwd",
        "/etc/passwd",
        "/1.png",
    ]
    assert set(opened) <= {path}
