"""measurements.json and the command that writes it: what is read, what is refused, and what a solve makes of it."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtlayout.api import load_solved
from gtlayout.cli.app import main
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.evaluate import evaluate
from gtlayout.io.measurements import FILE, measurement_entry, read_measurements
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.writing.scene_writers import write_scene
from gtlayout.measurement import ElementName, Measurement
from gtlayout.quality.assess import assess
from gtlayout.results.layout_files import write_results
from gtlayout.scene import scaled

UNIT_M = 2.5


@pytest.fixture(scope="module")
def solved_room(room: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The synthetic room, in units of 2.5 m that nobody knows, solved."""
    folder = tmp_path_factory.mktemp("measured") / "scene"
    scene = load_scene(room)
    frames = tuple(replace(frame, depth_path=None) for frame in scene.frames)
    write_scene(replace(scaled(replace(scene, frames=frames), 1 / UNIT_M), metric=False), folder, "native", "native")
    truth = json.loads((folder / "gt_planes.json").read_text())
    for plane in truth["planes"].values():
        plane["d"] /= UNIT_M
        plane["extent"] = [[[list(np.array(p) / UNIT_M) for p in ring] for ring in part] for part in plane["extent"]]
    (folder / "gt_planes.json").write_text(json.dumps(truth))
    assert main(["solve", str(folder), "--no-refine-cameras"]) == 0
    return folder


@pytest.fixture
def scene_dir(solved_room: Path, tmp_path: Path) -> Path:
    return shutil.copytree(solved_room, tmp_path / "scene")


def test_from_no_unit_to_a_plan_in_metres(scene_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The whole way by the command line: what to measure, measured, solved again, evaluated, exported."""
    assert main(["measure", str(scene_dir)]) == 0
    assert "it would give the scene its unit" in capsys.readouterr().out
    scene, before = load_solved(scene_dir)
    height = next(one for one in before.dimensions if one.kind == "height")
    names = [before.instances[i].name for i in (height.first, height.second)]
    tape_m = f"{UNIT_M * height.length:.4f}"
    assert main(["measure", str(scene_dir), "--between", *names, tape_m, "--sigma", "0.002"]) == 0
    out = capsys.readouterr().out
    assert f"{names[0]} – {names[1]} = " in out
    assert f"next: gtlayout solve {scene_dir}" in out
    (entry,) = json.loads((scene_dir / FILE).read_text())
    assert entry["between"] == names
    assert (entry["metres"], entry["sigma_m"]) == (float(tape_m), 0.002)
    ids = {(scene.frame_of(k).name, element.id) for k, key in enumerate(scene.key_frames) for element in key.elements}
    assert {tuple(one) for one in entry["elements"]} <= ids
    assert main(["measure", str(scene_dir)]) == 0
    assert f"1 more in {scene_dir / FILE}: solve the scene again" in capsys.readouterr().out

    assert main(["solve", str(scene_dir), "--no-refine-cameras", "--loa", "10"]) == 0
    out = capsys.readouterr().out
    assert "scale by what was measured: 1 unit of the cameras = 2.5 m" in out
    assert f"measured {names[0]} – {names[1]}: {float(tape_m):.3f} m, gives the scene its unit" in out
    solved_scene, layout = load_solved(scene_dir)
    assert solved_scene.metric and layout.metric
    assert layout.scale is not None
    assert layout.scale.factor == pytest.approx(UNIT_M, rel=1e-3)
    for new, old in zip(solved_scene.frames, scene.frames, strict=True):
        np.testing.assert_allclose(new.camera.center_world, layout.scale.factor * old.camera.center_world, atol=1e-9)
    after = next(one for one in layout.dimensions if one.kind == "height")
    assert after.length == pytest.approx(float(tape_m), abs=1e-4)
    assert after.sigma == pytest.approx(0.002, rel=0.02)
    assert after.accuracy is not None
    assert (after.accuracy.level, after.accuracy.status, after.accuracy.wanted) == (40, "within", 10)
    assert layout.measurements[0].used
    evaluation = evaluate(solved_scene, layout)
    assert max(plane.offset for plane in evaluation.planes) < 0.1, (
        "the truth, in the units of its file, is compared in metres"
    )

    config = Config(refine_cameras=False, loa=10)
    quality = assess(solved_scene, layout.instances, layout.planes, layout.extents, config.quality)
    write_results(scene_dir / "again", solved_scene, layout, quality, config)
    first, again = (json.loads((scene_dir / to / "layout.json").read_text()) for to in ("gtlayout", "again"))
    for part in ("dimensions", "quantities", "scale", "measurements", "next_measurement"):
        assert again[part] == first[part]

    assert main(["export", str(scene_dir), "--to", "csv"]) == 0
    with (scene_dir / "gtlayout/dimensions.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    (row,) = [one for one in rows if one["kind"] == "height"]
    assert float(row["value"]) == after.length
    assert (row["unit"], row["loa"], row["status"]) == ("m", "40", "within")
    assert float(row["error_95"]) == pytest.approx(1.96 * after.sigma, rel=1e-4)
    assert {one["kind"] for one in rows} >= {"surface", "floor area", "net wall area", "volume", "measured"}


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--between", "floor_0", "wall_99", "2.5"], "the layout has no instance wall_99"),
        (["--width", "floor_0", "2.5"], "floor_0 is neither door nor window"),
        (["--angle", "floor_0", "ceiling_0", "180"], "angles below 6° or above 174°"),
    ],
)
def test_what_is_of_nothing_is_refused_and_nothing_written(
    scene_dir: Path, arguments: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["measure", str(scene_dir), *arguments]) == 1
    assert reason in capsys.readouterr().err
    assert not (scene_dir / FILE).exists()


def test_door_leaves_are_assumed_only_when_asked_for(scene_dir: Path) -> None:
    assert main(["measure", str(scene_dir), "--door-leaf"]) == 0
    (entry,) = json.loads((scene_dir / FILE).read_text())
    assert entry["height"].startswith("door_")
    assert (entry["metres"], entry["sigma_m"], entry["assumed"]) == (2.01, 0.015, True)
    (read,) = load_scene(scene_dir).measurements
    assert read.assumed


def test_entries_are_read_as_they_are_written(tmp_path: Path) -> None:
    written = [
        Measurement("between", ("floor_0", "ceiling_0"), 2.513, 0.003, (ElementName("a.jpg", "7"), None)),
        Measurement("width", ("door_0",), 0.885, 0.003),
        Measurement("sill", ("window_0",), 0.9, 0.01),
        Measurement("angle", ("wall_0", "wall_1"), 90.4, 0.5),
        Measurement("height", ("door_0",), 2.01, 0.015, assumed=True),
    ]
    path = tmp_path / FILE
    path.write_text(json.dumps([measurement_entry(one) for one in written]))
    assert read_measurements(path, ()) == tuple(written)
    path.write_text('[{"width": "door_0", "metres": 0.885}, {"angle": ["a", "b"], "degrees": 90}]')
    assert [one.sigma for one in read_measurements(path, ())] == [0.003, 0.5]
    assert read_measurements(tmp_path / "absent.json", ()) == ()


@pytest.mark.parametrize(
    ("entry", "reason"),
    [
        ({"metres": 2}, "must have one of between, width, height, sill, angle, points"),
        ({"width": "a", "height": "b", "metres": 2}, "must have one of"),
        ({"width": "a"}, "metres must be a positive number up to 1000, not None"),
        ({"width": "a", "metres": True}, "metres must be a positive number"),
        ({"width": "a", "metres": float("nan")}, "metres must be a positive number"),
        ({"width": "a", "metres": 10**400}, "metres must be a positive number"),
        ({"width": "a", "metres": 2, "sigma_m": 0}, "sigma_m must be a positive number"),
        ({"width": "a", "degrees": 2}, "what is 'degrees'"),
        ({"angle": ["a", "b"], "degrees": 181}, "degrees must be a positive number up to 180"),
        ({"between": ["a", "a"], "metres": 2}, "between must be the names of two instances"),
        ({"between": "a", "metres": 2}, "between must be the names of two instances"),
        ({"width": ["a"], "metres": 2}, "width must be the name of an instance"),
        ({"width": "a", "metres": 2, "elements": [["x"]]}, "elements must be [image, id] of each instance"),
        ({"width": "a", "metres": 2, "assumed": 1}, "assumed must be true or false"),
        ({"points": [{}], "metres": 2}, "points must be a list of two"),
        ("width", "must be an object"),
    ],
)
def test_what_nobody_measured_is_refused(tmp_path: Path, entry: Any, reason: str) -> None:
    path = tmp_path / FILE
    path.write_text(json.dumps([{"width": "door_0", "metres": 0.9}, entry]))
    with pytest.raises(GtlayoutError) as caught:
        read_measurements(path, ())
    assert str(caught.value).startswith(f"{path}, entry 2: ")
    assert reason in str(caught.value)


def test_the_sigma_of_a_scale_is_part_of_the_unit(tiny: Path, tmp_path: Path) -> None:
    (tiny / "scene.json").write_text('{"metric": true, "scale_sigma": 0.01}')
    scene = load_scene(tiny)
    assert (scene.metric, scene.scale_sigma_share) == (True, 0.01)
    write_scene(scene, tmp_path / "copy", "native", "native")
    assert load_scene(tmp_path / "copy").scale_sigma_share == 0.01
    for bad in (
        '{"scale_sigma": 0.01}',
        '{"metric": false, "scale_sigma": 0.01}',
        '{"unit": "m", "scale_sigma": "1%"}',
    ):
        (tiny / "scene.json").write_text(bad)
        with pytest.raises(GtlayoutError, match="scale_sigma"):
            load_scene(tiny)


def test_measurements_go_with_a_scene_that_is_written_anew(tiny: Path, tmp_path: Path) -> None:
    names = [f"{i:03d}.png" for i in (1, 3)]
    points = [{name: [20, 20] for name in names}, {name: [40, 30] for name in names}]
    entries = [
        {"between": ["wall_0", "wall_1"], "metres": 3.0, "elements": [[names[0], "e0"], None]},
        {"points": points, "metres": 0.5},
    ]
    (tiny / FILE).write_text(json.dumps(entries))
    scene = load_scene(tiny)
    write_scene(scene, tmp_path / "copy", "native", "native")
    copied = load_scene(tmp_path / "copy")
    assert copied.measurements == scene.measurements
