"""The runner of evaluations, and the scripts for CAD-Estate and ScanNet, end to end on folders in their formats."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rooms
from measures import measure

import re10k_iou
import scannet_depth
from common import table1
from common.metrics import read_rows
from common.runner import SceneRows, errors_of, find_scenes, run_scenes
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.export.cad_estate import write_cad_estate
from gtlayout.io.cad_estate.room_structure import RoomStructure
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.writing.scene_writers import write_scene
from gtlayout.method import solve
from gtlayout.scene import Scene
from gtlayout.synth import SynthConfig, synthesize

Edit = Callable[[Path, Callable[[Any], object]], None]


@pytest.fixture(scope="module")
def releases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``annotations/`` with two clips and their published layouts, ``scannet/`` with two exports, of the same rooms."""
    root = tmp_path_factory.mktemp("releases")
    for seed in (0, 1):
        synthesize(root / f"own/{seed}", SynthConfig(seed=seed, frames=12, width=160, height=120, oversample=1))
        scene = load_scene(root / f"own/{seed}")
        write_cad_estate(scene, root / f"annotations/video_{seed}", solve(scene, Config()).layout)
        write_scene(scene, root / f"scannet/scene000{seed}_00", "scannet", "native")
    return root


def test_cad_estate_end_to_end(
    releases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], edit_json: Edit, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, out = tmp_path / "annotations", tmp_path / "out"
    shutil.copytree(releases / "annotations", root)
    shutil.copytree(root / "video_0", root / "video_broken")
    edit_json(root / "video_broken" / "frames.json", lambda data: data.pop("frames"))
    shutil.copytree(root / "video_0", root / "video_grey")
    for image in (root / "video_grey/video").iterdir():
        image.write_bytes(cv2.imencode(".jpg", np.full((120, 160, 3), 128, dtype=np.uint8))[1].tobytes())
    shutil.copytree(root / "video_0", root / "video_unannotated")
    shutil.rmtree(root / "video_unannotated/structure_annotations")

    assert re10k_iou.main([str(root), "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("| method | scenes | failed ↓ | unreadable ↓ | accepted ↑ | iou ↑ | iou_accepted ↑ |")
    assert "1 of 5 scenes left out: no annotations" in printed.err
    assert "video_broken: " in printed.err
    assert "video_grey: " in printed.err

    summary = _values(out / "summary.json")
    ours, theirs = summary["gtlayout"], summary["published"]
    assert (ours["scenes"], ours["failed"], ours["unreadable"]) == (3, 1, 1)
    assert (theirs["scenes"], theirs["failed"], theirs["unreadable"]) == (3, 0, 1)
    scenes = _values(out / "scenes.json")
    assert list(scenes) == ["video_0", "video_1", "video_grey"]
    good = [scenes[name]["iou"] for name in ("video_0", "video_1")]
    assert min(good) > 0.85
    # Grey images give no layout: IoU 0, not accepted; what was published does not depend on images.
    assert (scenes["video_grey"]["iou"], scenes["video_grey"]["accepted"]) == (0, 0)
    assert ours["iou"] == pytest.approx(sum(good) / 3)
    assert ours["iou_accepted"] == pytest.approx(sum(good) / 2)
    assert ours["accepted"] == pytest.approx(2 / 3)
    assert theirs["accepted"] == 1
    assert scenes["video_grey"]["published_iou"] == scenes["video_0"]["published_iou"] > 0.85
    assert np.isnan(ours["depth_error"])
    assert {path.name for path in out.iterdir()} == {
        *(f"{name}.{suffix}" for name in ("scenes", "summary") for suffix in ("md", "csv", "json")),
        "gtlayout",
        "published",
    }

    # Nothing changed: a second run solves only what failed, and says the same.
    before = (out / "summary.json").read_bytes()
    solved: list[Path] = []

    def solve_and_tell(path: Path) -> SceneRows:
        solved.append(path)
        return table1.measure_ours(path)

    monkeypatch.setattr(re10k_iou, "measure_ours", solve_and_tell)
    monkeypatch.setattr(re10k_iou, "measure_published", lambda path: pytest.fail(f"{path} was measured again"))
    (root / "video_broken").rename(tmp_path / "elsewhere")
    assert re10k_iou.main([str(root), "--out", str(out)]) == 0
    assert [path.name for path in solved] == ["video_grey"]
    assert _values(out / "summary.json")["gtlayout"]["iou"] == json.loads(before)["rows"]["gtlayout"][4]["value"]


def test_scannet_end_to_end(
    releases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    root, out = tmp_path / "scans", tmp_path / "out"
    shutil.copytree(releases / "scannet", root)
    assert scannet_depth.main([str(root), "--out", str(out)]) == 0
    ours = _values(out / "summary.json")["gtlayout"]
    assert (ours["scenes"], ours["failed"], ours["unreadable"], ours["accepted"]) == (2, 0, 0, 1)
    assert 0 < ours["depth_error_trimmed"] <= ours["depth_error"] < 0.1
    assert ours["depth_error_accepted"] == ours["depth_error"]
    with (out / "scenes.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["scene"] for row in table] == ["scene0000_00", "scene0001_00"]
    assert np.mean([float(row["depth_error_m"]) for row in table]) == pytest.approx(ours["depth_error"])

    # One file changes: that scene alone is measured again, and failing now, it counts as such.
    before = (out / "summary.md").read_text()
    monkeypatch.setattr(scannet_depth, "measure_ours", _fails)
    assert scannet_depth.main([str(root), "--out", str(out)]) == 0
    assert (out / "summary.md").read_text() == before
    (root / "scene0001_00/annotations.json").write_text((root / "scene0001_00/annotations.json").read_text() + " ")
    capsys.readouterr()
    assert scannet_depth.main([str(root), "--out", str(out)]) == 0
    assert capsys.readouterr().err == "scene0001_00: ValueError: no such luck (test_eval_scripts.py:N)\n".replace(
        "N", str(_fails.__code__.co_firstlineno + 1)
    )
    after = _values(out / "summary.json")["gtlayout"]
    assert (after["failed"], after["accepted"]) == (1, 0.5)
    assert after["iou"] == pytest.approx(_values(out / "scenes.json")["scene0000_00"]["iou"] / 2)


def test_own_scenes_without_depth(releases: Path, tmp_path: Path) -> None:
    """A single scene as root, with no depth and no unit: those columns stay empty."""
    shutil.copytree(releases / "own/0", tmp_path / "room")
    shutil.rmtree(tmp_path / "room/depth")
    (tmp_path / "room/scene.json").unlink(missing_ok=True)
    assert scannet_depth.main([str(tmp_path / "room"), "--out", str(tmp_path / "out")]) == 0
    row = _values(tmp_path / "out/scenes.json")["room"]
    assert np.isnan(row["depth_error"])
    assert row["iou"] > 0.85


def test_command_lines_say_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for script, name in ((re10k_iou, "re10k_iou"), (scannet_depth, "scannet_depth")):
        assert script.main([str(tmp_path / "nowhere"), "--out", str(tmp_path / "out")]) == 1
        assert capsys.readouterr().err.startswith(f"{name}: no folder ")
        assert script.main([str(tmp_path), "--out", str(tmp_path / "out")]) == 1
        assert "frames.json (CAD-Estate)" in capsys.readouterr().err
        assert script.main([]) == 2
        capsys.readouterr()
    assert not (tmp_path / "out").exists()


def test_published_iou_in_closed_form() -> None:
    """Half of the first wall is published, and all of the second: IoU (1/2 + 1) / 2 in one frame, 1 in the other."""
    drawn = [rooms.pixels(10, 10, 50, 70), rooms.pixels(60, 10, 90, 70)]
    scene = rooms.make_scene(
        [rooms.facing_camera()] * 2, [[("wall", drawn[0]), ("wall", drawn[1])], [("wall", drawn[1])]]
    )
    scene = _renamed(scene, [["1", "2"], ["2"]])
    published = [rooms.facing(10, 10, 30, 70).corners, rooms.facing(60, 10, 90, 70).corners]
    structure = RoomStructure(
        clip_name="video_0",
        triangles=np.concatenate([corners[[[0, 1, 2], [0, 2, 3]]] for corners in published]),
        triangle_element=np.array([1, 1, 2, 2]),
        triangle_flags=np.array([0, 0, 2, 0]),
        labels=(None, "wall", "wall"),
        annotated_timestamps=np.array([0, 1]),
    )
    assert re10k_iou.published_iou(scene, structure) == pytest.approx((0.75 + 1) / 2)
    with pytest.raises(GtlayoutError, match="not those of the published layout"):
        re10k_iou.published_iou(_renamed(scene, [["1", "3"], ["2"]]), structure)


def test_runner_in_processes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A scene that raises, and one that takes its process along, cost only themselves."""
    scenes = _folders(tmp_path, "crash", "good", "raises")
    results = run_scenes(scenes, tmp_path / "out", measure, "test", jobs=2)
    assert list(results) == ["good"]
    assert [metric.value for metric in results["good"]["row"]] == [0.1, 1]
    assert list(errors_of(scenes, tmp_path / "out")) == ["crash", "raises"]
    assert "raises: no luck here" in capsys.readouterr().err


def test_runner_resumes(tmp_path: Path) -> None:
    scenes = _folders(tmp_path, "good", "nan", "raises")
    out = tmp_path / "good" / "out"  # Results within a scene are none of its inputs.
    first = run_scenes(scenes, out, measure, "test")
    assert list(first) == ["good", "nan"]
    again = run_scenes(scenes, out, measure, "test")
    assert _runs(scenes) == {"good": 1, "nan": 1, "raises": 2}
    assert again["good"]["row"][0] == first["good"]["row"][0]
    assert np.isnan(again["nan"]["row"][0].value)
    (scenes["good"] / "transforms.json").write_text("[]")
    run_scenes(scenes, out, measure, "test")
    assert _runs(scenes) == {"good": 2, "nan": 1, "raises": 3}
    run_scenes(scenes, out, measure, "other settings")
    assert _runs(scenes) == {"good": 3, "nan": 2, "raises": 4}
    (out / "scenes/nan.json").write_text("{ cut o")
    run_scenes(scenes, out, measure, "other settings")
    assert _runs(scenes) == {"good": 3, "nan": 3, "raises": 5}


def test_runner_notices_images_outside_the_scene(releases: Path, tmp_path: Path) -> None:
    """As in the release: annotations/<clip> and frames/<video> side by side."""
    clip = tmp_path / "annotations/video_0"
    shutil.copytree(releases / "annotations/video_0", clip)
    (tmp_path / "frames").mkdir()
    (clip / "video").rename(tmp_path / "frames/video")
    for _ in range(2):
        run_scenes({"clip": clip}, tmp_path / "out", measure, "test")
    assert _runs({"clip": clip}) == {"clip": 1}
    (tmp_path / "frames/video/video_0.jpg").unlink()
    run_scenes({"clip": clip}, tmp_path / "out", measure, "test")
    assert _runs({"clip": clip}) == {"clip": 2}


def test_find_scenes(tmp_path: Path) -> None:
    scenes = _folders(tmp_path, "b", "a")
    (tmp_path / "neither").mkdir()
    assert find_scenes(tmp_path) == {"a": scenes["a"], "b": scenes["b"]}
    assert find_scenes(scenes["a"]) == {"a": scenes["a"]}
    with pytest.raises(GtlayoutError, match=r"no scene in .*neither.*transforms\.json \(nerfstudio\)"):
        find_scenes(tmp_path / "neither")
    with pytest.raises(GtlayoutError, match="cannot be a file name"):
        run_scenes({"../a": scenes["a"]}, tmp_path / "out", measure, "test")


def _fails(_folder: Path) -> SceneRows:
    raise ValueError("no such luck")


def _folders(root: Path, *names: str) -> dict[str, Path]:
    for name in names:
        (root / name).mkdir()
        (root / name / "transforms.json").write_text("{}")
    return {name: root / name for name in names}


def _runs(scenes: dict[str, Path]) -> dict[str, int]:
    return {name: len((path / ".runs").read_text()) for name, path in scenes.items()}


def _values(path: Path) -> dict[str, dict[str, float]]:
    return {label: {metric.key: metric.value for metric in row} for label, row in read_rows(path).items()}


def _renamed(scene: Scene, ids: list[list[str]]) -> Scene:
    key_frames = tuple(
        replace(key, elements=tuple(replace(e, id=new) for e, new in zip(key.elements, names, strict=True)))
        for key, names in zip(scene.key_frames, ids, strict=True)
    )
    return replace(scene, key_frames=key_frames)
