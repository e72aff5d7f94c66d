"""Poses with noise, mirrored or wrong: one function, and every reader that has poses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from camera_formats import FORMATS, cameras_in_general_position
from scene_checks import assert_one_camera_skipped

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.poses import rigid
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import FloatArray

NINE = [(i, j) for i in range(3) for j in range(3)]
POSE = np.eye(4)
POSE[:3, :3] = cv2.Rodrigues(np.array([0.4, -0.7, 1.1]))[0]
POSE[:3, 3] = (1.5, -2.5, 3.5)


def changed(row: int, column: int, by: float) -> FloatArray:
    pose = POSE.copy()
    pose[row, column] += by
    return pose


def test_float32_noise_is_taken_out() -> None:
    rng = np.random.default_rng(0)
    noisy = POSE + rng.uniform(-2e-7, 2e-7, (4, 4))
    rotation, translation = rigid(noisy, "a pose")
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(rotation, POSE[:3, :3], atol=1e-6)
    np.testing.assert_array_equal(translation, noisy[:3, 3])


@pytest.mark.parametrize(("by", "fits"), [(0.9e-4, True), (1.1e-4, False), (-1.1e-4, False), (1.0, False)])
@pytest.mark.parametrize("column", range(4))
def test_last_row(column: int, by: float, fits: bool) -> None:
    pose = changed(3, column, by)
    if fits:
        np.testing.assert_allclose(rigid(pose, "a pose")[0], POSE[:3, :3], atol=1e-12)
    else:
        with pytest.raises(GtlayoutError, match=rf"^a pose must end with the row 0 0 0 1 \(off by {abs(by):.2g}"):
            rigid(pose, "a pose")


@pytest.mark.parametrize(("scale", "fits"), [(1.0004, True), (1.0006, False)])
def test_rotation_within_rounding(scale: float, fits: bool) -> None:
    pose = POSE.copy()
    pose[:3, :3] *= scale
    if fits:
        np.testing.assert_allclose(rigid(pose, "a pose")[0], POSE[:3, :3], atol=1e-12)
    else:
        with pytest.raises(GtlayoutError, match=r"^a pose is no rotation \(off by 0.0012, rounding explains 0.001\)"):
            rigid(pose, "a pose")


@pytest.mark.parametrize("flip", [np.diag([-1.0, 1, 1]), np.eye(3)[[1, 0, 2]], -np.eye(3)])
def test_mirrored(flip: FloatArray) -> None:
    pose = POSE.copy()
    pose[:3, :3] = pose[:3, :3] @ flip
    with pytest.raises(GtlayoutError, match=r"^a pose is mirrored, no rotation .*one axis, or the order of two"):
        rigid(pose[:3], "a pose")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_not_finite(bad: float) -> None:
    with pytest.raises(GtlayoutError, match=r"^a pose must be 4x4 .or 3x4. finite numbers"):
        rigid(changed(0, 3, bad), "a pose")
    with pytest.raises(GtlayoutError, match=r"^a pose must be 4x4"):
        rigid(np.eye(3), "a pose")


Change = Callable[[FloatArray], FloatArray]


def _in_json(places: Callable[[Any], list[tuple[Any, str | int]]]) -> Callable[[Path, Change], None]:
    """Of a JSON file: what holds each of the nine numbers, and its key there."""

    def edit(file: Path, change: Change) -> None:
        data = json.loads(file.read_text())
        found = places(data)
        R = change(np.array([holder[key] for holder, key in found]).reshape(3, 3))
        for (holder, key), value in zip(found, R.ravel(), strict=True):
            holder[key] = float(value)
        file.write_text(json.dumps(data))

    return edit


def _in_text(row: int, first: int, step: int, lines: int) -> Callable[[Path, Change], None]:
    """Of a text file: line ``row``, its word ``first``, and the words from one row of the matrix to the next."""

    def edit(file: Path, change: Change) -> None:
        words = [line.split() for line in file.read_text().splitlines()]
        where = [(row + i * lines, first + i * step + j) for i, j in NINE]
        R = change(np.array([float(words[a][b]) for a, b in where]).reshape(3, 3))
        for (a, b), value in zip(where, R.ravel(), strict=True):
            words[a][b] = repr(float(value))
        file.write_text("\n".join(" ".join(line) for line in words) + "\n")

    return edit


EDITS: dict[str, Callable[[Path, Change], None]] = {
    "nerfstudio": _in_json(lambda data: [(data["frames"][2]["transform_matrix"][i], j) for i, j in NINE]),
    "polycam": _in_json(lambda data: [(data, f"t_{i}{j}") for i, j in NINE]),
    "scannet": _in_text(0, 0, 0, 1),
    "seven_scenes": _in_text(0, 0, 0, 1),
    "re10k": _in_text(3, 7, 4, 0),
}
"""How to change a rotation matrix in the file of one camera; quaternions and axis-angles cannot be mirrored."""


@pytest.mark.parametrize("name", EDITS)
def test_every_reader_with_matrices(name: str, tmp_path: Path) -> None:
    files = FORMATS[name](tmp_path, cameras_in_general_position())
    file = files[2] if len(files) > 2 else files[0]
    before = load_scene(tmp_path)
    EDITS[name](file, lambda R: R + np.float32(1e-7))
    noisy = load_scene(tmp_path)
    assert noisy.warnings == before.warnings
    assert len(noisy.frames) == 5
    EDITS[name](file, lambda R: R @ np.diag([1.0, 1.0, -1.0]))
    mirrored = load_scene(tmp_path)
    assert len(mirrored.frames) == 4
    assert_one_camera_skipped(mirrored.warnings, "1 of 5 .* is mirrored")
