"""Broken and hostile camera files: a scene or one clear error, nothing written, nothing read outside the folder."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_formats import FORMATS, cameras_in_general_position
from hypothesis import given, settings
from hypothesis import strategies as st

from gtlayout.errors import GtlayoutError
from gtlayout.io.scene_folder import load_scene

EXAMPLES = settings(max_examples=25, deadline=None, derandomize=True, database=None)
RAW = "@raw@"
JSON_VALUES: list[Any] = [
    *(None, True, "", "x", -1, 0, 0.5, 1e308, -1e308, 1e-308, 65536, 2**31, 2**63, 2**64, 10**400, [], {}, [[[1]]]),
    *(
        "../secret.jpg",
        "/etc/hostname",
        "C:\\x",
        "a\nb",
        "a\0b",
        "\ud800",
        "n" * 300,
        "n/" * 3000,
        [None] * 5,
        {"a": 1},
    ),
    *(RAW + "NaN", RAW + "1e400", RAW + "-Infinity", RAW + "9" * 5000, RAW + "[" * 20_000 + "]" * 20_000),
    *("EQUIRECTANGULAR", "FULL_OPENCV", "42446103_1.png"),
]
TOKENS = [
    *("nan", "inf", "-inf", "1e400", "1e308", "-1", "0", "9" * 400, "x", "", "1_0", "0x10", "é", "a\0b", "\n"),
    *("../secret.jpg", "/etc/hostname", "65537", "4294967296", "18446744073709551615", "n" * 300, "n/" * 3000),
]
COUNTS = [
    b"\xff" * 8,
    b"\0" * 8,
    (10**9).to_bytes(8, "little"),
    (2**40).to_bytes(8, "little"),
    b"../../x\0",
    b"\0\x7f" * 4,
]


@dataclass(frozen=True)
class Target:
    """A correct scene folder, to be damaged one file at a time."""

    root: Path
    files: list[Path]
    listing: dict[Path, int]

    def survives(self, file: Path, content: bytes) -> None:
        """The one property."""
        whole = file.read_bytes()
        file.write_bytes(content)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                scene = load_scene(self.root)
        except GtlayoutError as error:
            message = str(error)
            assert message.isprintable()
            assert str(self.root) in message
        else:
            for path in (*(f.image_path for f in scene.frames), *(f.depth_path for f in scene.frames if f.depth_path)):
                assert path.resolve().is_relative_to(self.root)
            assert all(np.all(np.isfinite(frame.camera.rays_world(np.zeros((1, 2))))) for frame in scene.frames)
            assert all(np.all(np.isfinite(frame.camera.center_world)) for frame in scene.frames)
            assert all(warning.isprintable() for warning in scene.warnings)
        finally:
            file.write_bytes(whole)
        assert _listing(self.root) == self.listing


@pytest.fixture(scope="module", params=FORMATS)
def target(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Target]:
    root = tmp_path_factory.mktemp("hostile").resolve() / request.param
    root.mkdir()
    files = FORMATS[request.param](root, cameras_in_general_position())
    image = load_scene(root).frames[0].image_path
    (root.parent / "secret.jpg").write_bytes(image.read_bytes())
    yield Target(root, files, _listing(root))
    assert sorted(path.name for path in root.parent.iterdir()) == sorted([root.name, "secret.jpg"])


@EXAMPLES
@given(data=st.data())
def test_truncated(target: Target, data: st.DataObject) -> None:
    file = data.draw(st.sampled_from(target.files))
    content = file.read_bytes()
    target.survives(file, content[: data.draw(st.integers(0, max(0, len(content) - 1)))])


@EXAMPLES
@given(data=st.data())
def test_random_content(target: Target, data: st.DataObject) -> None:
    file = data.draw(st.sampled_from(target.files))
    target.survives(file, data.draw(st.one_of(st.binary(max_size=300), st.text(max_size=300).map(_encoded))))


@EXAMPLES
@given(data=st.data())
def test_one_value_replaced(target: Target, data: st.DataObject) -> None:
    file = data.draw(st.sampled_from(target.files))
    content = file.read_bytes()
    if file.suffix == ".json":
        tree = json.loads(content)
        places = list(_places(tree))
        holder, key = places[data.draw(st.integers(0, len(places) - 1))]
        holder[key] = data.draw(st.sampled_from(JSON_VALUES))
        target.survives(file, _dumped(tree))
    elif file.suffix == ".bin":
        at = data.draw(st.integers(0, max(0, len(content) - 8)))
        count = data.draw(st.sampled_from(COUNTS))
        target.survives(file, content[:at] + count + content[at + 8 :])
    else:
        lines = [line.split(" ") for line in content.decode().split("\n")]
        row = data.draw(st.integers(0, len(lines) - 1))
        lines[row][data.draw(st.integers(0, len(lines[row]) - 1))] = data.draw(st.sampled_from(TOKENS))
        target.survives(file, "\n".join(" ".join(line) for line in lines).encode())


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every holder and key in a JSON tree."""
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
        yield tree, key
        if isinstance(tree[key], dict | list):
            yield from _places(tree[key])


def _dumped(tree: Any) -> bytes:
    text = json.dumps(tree)
    for value in JSON_VALUES:
        if isinstance(value, str) and value.startswith(RAW):
            text = text.replace(f'"{value}"', value.removeprefix(RAW))
    return text.encode()


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


def _listing(root: Path) -> dict[Path, int]:
    return {path: path.stat().st_size for path in sorted(root.rglob("*")) if path.is_file()}
