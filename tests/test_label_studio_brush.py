"""Label Studio's run-length encoding of brush masks, against its own encoder and decoder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from label_studio_writer import pack
from shapely import Polygon
from tools_env import run_tool

from gtlayout.io.annotations.label_studio.brush import BrokenMaskError, decode_mask
from gtlayout.io.annotations.label_studio.geometry import region_geometry
from gtlayout.scene import BoolArray


def test_runs_of_a_brush_mask() -> None:
    pixels = [0, 0, 255, 130, 120, 0]
    rgba = [value for alpha in pixels for value in (0, alpha, 7, alpha)]
    packed = pack([(True, 2, [0] * 5), (False, 3, rgba[5:7]), (False, 2, rgba[7:])], 24)
    assert decode_mask(packed, (3, 2)).tolist() == [[False, False, True], [True, False, False]]
    ones = pack([(True, 0, [0] * 4), (True, 1, [1] * 8)], 12)
    assert decode_mask(ones, (3, 1)).tolist() == [[False, True, True]]


@pytest.mark.parametrize(
    ("rle", "size", "problem"),
    [
        (b"", (3, 1), "ends too early"),
        (pack([(True, 1, [1] * 8)], 12), (3, 1), "ends too early"),
        (pack([(True, 1, [1] * 8)], 8), (3, 1), "holds 8 values, 3x1 px need 12"),
        (pack([(True, 1, [1] * 16)], 12), (3, 1), "a run beyond its end"),
        (pack([], 12), (100_000, 100_000), "too large"),
        (b"\0\0\0\x0c\xff", (3, 1), "values of 32 bits"),
    ],
)
def test_broken_brush_masks(rle: bytes, size: tuple[int, int], problem: str) -> None:
    with pytest.raises(BrokenMaskError, match=problem):
        decode_mask(rle, size)


def holed_mask() -> BoolArray:
    rows, columns = np.mgrid[:48, :64]
    disc = (columns - 30) ** 2 + (rows - 22) ** 2 < 18**2
    disc[18:26, 24:36] = False
    return disc


def test_brush_masks_of_the_real_tool(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).random((13, 7)) > 0.5
    masks = {"disc": holed_mask(), "noise": noise, "full": np.ones((3, 5), dtype=bool), "empty": np.zeros((2, 2), bool)}
    as_bytes: dict[str, Any] = {key: np.where(mask, 255, 0).astype(np.uint8) for key, mask in masks.items()}
    np.savez(tmp_path / "masks.npz", **as_bytes)
    run_tool("make_label_studio.py", "brush", str(tmp_path / "masks.npz"), str(tmp_path / "rle.json"))
    rles = json.loads((tmp_path / "rle.json").read_text())
    for key, mask in masks.items():
        np.testing.assert_array_equal(decode_mask(bytes(rles[key]), (mask.shape[1], mask.shape[0])), mask)
    rings, _ = region_geometry({"format": "rle", "rle": rles["disc"]}, (64, 48))
    wall = shapely.union_all([Polygon(ring * (0.64, 0.48)) for ring in rings])
    assert wall.area == pytest.approx(masks["disc"].sum(), rel=0.02)
    assert not wall.intersects(shapely.box(25, 19, 35, 25))


def test_our_runs_are_read_the_same_by_the_real_tool(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    packed, sizes = [], [(5, 3), (16, 9), (1, 1)]
    for lengths, (width, height) in zip([(3, 4, 8, 16), (1, 2, 5, 9), (2, 2, 2, 2)], sizes, strict=True):
        count, runs = 4 * width * height, []
        while count:
            repeated, which = bool(rng.integers(2)), int(rng.integers(4))
            length = int(rng.integers(1, min(count, 2 ** lengths[which]) + 1))
            values = [int(v) for v in rng.choice([0, 255], length)]
            runs.append((repeated, which, values[:1] * length if repeated else values))
            count -= length
        packed.append([*pack(runs, 4 * width * height, lengths)])
    (tmp_path / "rle.json").write_text(json.dumps(packed))
    run_tool("make_label_studio.py", "decode", str(tmp_path / "rle.json"), str(tmp_path / "out.npz"))
    with np.load(tmp_path / "out.npz") as decoded:
        for rle, (width, height), key in zip(packed, sizes, decoded.files, strict=True):
            alpha = decoded[key].reshape(height, width, 4)[:, :, 3]
            np.testing.assert_array_equal(decode_mask(bytes(rle), (width, height)), alpha > 0)
