"""The command line on a small synthetic room: exit statuses, the files written, and nothing written on bad input."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import gtlayout.method
from gtlayout.cli.app import main
from gtlayout.export import EXPORTERS
from gtlayout.io.scene_folder import load_scene
from gtlayout.results.layout_reader import read_layout
from gtlayout.version import __version__

RESULTS = {"layout.json", "layout.glb", "layout.ply", "quality.json", "review.json", "config.json", "evidence.json"}
TIMINGS = "timings.json"

Edit = Callable[[Path, Callable[[Any], object]], None]


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The installed command in a process of its own."""
    command = [Path(sys.executable).with_name("gtlayout"), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def solved(room: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder of results, and what was printed."""
    out = tmp_path_factory.mktemp("solved") / "not yet there"
    done = run("solve", room, "--out", out, "-v")
    assert done.returncode == 0, done.stderr
    assert done.stderr == "", "progress bars belong to terminals only"
    return out, done.stdout


@pytest.fixture
def scene(room: Path, tmp_path: Path) -> Path:
    """A copy of the room to break."""
    return Path(shutil.copytree(room, tmp_path / "scene"))


def test_solve_writes_its_files(room: Path, solved: tuple[Path, str]) -> None:
    out, _ = solved
    assert {file.name for file in out.iterdir()} == RESULTS | {TIMINGS}
    assert json.loads((out / TIMINGS).read_text())["seconds"].keys() >= {"tracking", "estimation"}
    assert not (room / "gtlayout").exists()
    layout = json.loads((out / "layout.json").read_text())
    assert layout["metric"] is True
    quality = json.loads((out / "quality.json").read_text())
    assert quality["accepted"] is True
    assert quality["iou"] > 0.9
    config = json.loads((out / "config.json").read_text())
    assert config["versions"]["gtlayout"] == __version__
    assert config["config"]["restarts"] == 1


def test_mesh_files_hold_the_room(room: Path, solved: tuple[Path, str]) -> None:
    out, _ = solved
    ply = trimesh.load(out / "layout.ply", force="mesh", process=False)
    glb = trimesh.load(out / "layout.glb", force="scene")
    assert isinstance(ply, trimesh.Trimesh)
    assert isinstance(glb, trimesh.Scene)
    assert ply.area > 10
    assert set(glb.geometry) == {instance.name for instance in read_layout(out, load_scene(room)).instances}
    # The cameras' world for PLY: its floor lies where the truth says, and the cameras stand above it.
    truth = json.loads((room / "gt_planes.json").read_text())["planes"]["floor"]
    lowest = float((ply.vertices @ np.array(truth["normal"])).min() + truth["d"])
    assert abs(lowest) < 0.1
    # y-up for GLB: the floor is level and the ceiling above it.
    assert np.ptp(glb.geometry["floor_0"].vertices[:, 1]) < 5e-3, "level, but for vertices shared with walls"
    assert glb.geometry["ceiling_0"].vertices[:, 1].min() > glb.geometry["floor_0"].vertices[:, 1].max() + 2


def test_solve_prints_table_timings_and_verdict(room: Path, solved: tuple[Path, str]) -> None:
    out, printed = solved
    for instance in read_layout(out, load_scene(room)).instances:
        assert instance.name in printed
    for stage in ("tracking", "correspondence", "edges", "estimation", "extents", "mesh", "quality"):
        assert stage in printed
    quality = json.loads((out / "quality.json").read_text())
    assert quality["headline"]["word"] == "trust"
    assert printed.splitlines()[0] == f"TRUST: {quality['headline']['reasons'][0]}"
    assert f"\nIoU {quality['iou']:.3f} (accepted" in printed
    assert "Worst frame" in printed
    assert f"; σ of depth {100 * quality['sigma_depth_share']:.1f} % (predicted {quality['predicted']})." in printed
    assert "height floor_0 – ceiling_0: " in printed
    assert f"Results: {out}" in printed
    assert max(map(len, printed.splitlines()[:9])) <= 80


def test_two_runs_write_the_same_bytes(room: Path, solved: tuple[Path, str], tmp_path: Path) -> None:
    assert run("solve", room, "--out", tmp_path).returncode == 0
    for name in RESULTS:
        assert (tmp_path / name).read_bytes() == (solved[0] / name).read_bytes(), name


def test_evaluate_against_the_truth(room: Path, solved: tuple[Path, str]) -> None:
    done = run("evaluate", room, "--layout", solved[0])
    assert done.returncode == 0, done.stderr
    assert "reprojection IoU" in done.stdout
    assert "predicted σ of depth" in done.stdout
    figures = json.loads(run("evaluate", room, "--layout", solved[0], "--json").stdout)
    assert figures["depth"]["median"] < 0.015
    assert figures["elements_on_right_instance"] == figures["elements"] > 0
    assert figures["missing_planes"] == []
    assert figures["iou"] == pytest.approx(json.loads((solved[0] / "quality.json").read_text())["iou"], abs=1e-3)


def test_restarts_never_lose_iou(room: Path, solved: tuple[Path, str], tmp_path: Path) -> None:
    assert main(["solve", str(room), "--out", str(tmp_path), "--restarts", "3"]) == 0
    once, best = (json.loads((out / "quality.json").read_text())["iou"] for out in (solved[0], tmp_path))
    assert best >= once


def _drop_cameras_of_key_frames(scene: Path, edit_json: Edit) -> None:
    names = {frame["image"] for frame in json.loads((scene / "annotations.json").read_text())["frames"]}
    edit_json(
        scene / "transforms.json",
        lambda d: d.update(frames=[f for f in d["frames"] if Path(f["file_path"]).name not in names]),
    )


def _two_frames(scene: Path, edit_json: Edit) -> None:
    edit_json(scene / "transforms.json", lambda d: d.update(frames=d["frames"][:2]))
    edit_json(scene / "annotations.json", lambda d: d.update(frames=d["frames"][:1]))


def _stand_still(scene: Path, edit_json: Edit) -> None:
    def change(data: Any) -> None:
        for frame in data["frames"]:
            for row, first in zip(frame["transform_matrix"], data["frames"][0]["transform_matrix"], strict=True):
                row[3] = first[3]

    edit_json(scene / "transforms.json", change)


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (lambda scene, _: (scene / "transforms.json").unlink(), "no cameras in"),
        (lambda scene, _: (scene / "annotations.json").unlink(), "no annotations in"),
        (lambda scene, _: shutil.rmtree(scene / "images"), "images"),
        (_drop_cameras_of_key_frames, "no usable element in any frame (annotated image"),
        (_two_frames, "at least 3"),
        (_stand_still, "the camera does not move, so all planes are unobservable: "),
        (lambda scene, edit: edit(scene / "annotations.json", lambda d: d.update(frames=[])), "annotations.json"),
        (lambda scene, _: shutil.rmtree(scene), "no scene folder"),
    ],
)
def test_bad_scene_is_one_line_and_leaves_nothing(
    scene: Path, edit_json: Edit, capfd: pytest.CaptureFixture[str], break_it: Callable[[Path, Edit], None], says: str
) -> None:
    break_it(scene, edit_json)
    before = sorted(scene.rglob("*"))
    assert main(["solve", str(scene), "--rerun", "save"]) == 1
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("gtlayout: ")
    assert printed.err.count("\n") == 1
    assert says in printed.err
    assert sorted(scene.rglob("*")) == before


def test_bad_polygons_are_repaired_and_said(scene: Path, edit_json: Edit, capfd: pytest.CaptureFixture[str]) -> None:
    def spoil(data: Any) -> None:
        elements = data["frames"][0]["elements"]
        elements.append({"id": "few", "label": "wall", "polygons": [[[0, 0], [9, 9]]], "visible": []})
        elements.append({"id": "off", "label": "wall", "polygons": [[[-9, 0], [-9, 9], [-1, 9]]], "visible": []})
        elements[0]["visible"].append([[10, 10], [30, 30], [30, 10], [10, 30]])

    edit_json(scene / "annotations.json", spoil)
    assert main(["solve", str(scene), "-v"]) == 0
    warnings = [line for line in capfd.readouterr().out.splitlines() if line.startswith("warning: ")]
    assert any("few" in line for line in warnings)
    assert any("off" in line for line in warnings)
    assert len(warnings) >= 3, warnings
    assert json.loads((scene / "gtlayout/quality.json").read_text())["warnings"]


def test_unreadable_image_is_skipped_and_counted(scene: Path, capfd: pytest.CaptureFixture[str]) -> None:
    image = load_scene(scene).frames[11].image_path
    image.write_bytes(image.read_bytes()[:100])
    assert main(["solve", str(scene)]) == 0
    assert f"warning: 1 unreadable image(s) skipped: {image.name}" in capfd.readouterr().out


def test_results_cannot_go_into_a_file(room: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    taken = tmp_path / "taken"
    taken.write_text("mine")
    for out in (taken, taken / "below"):
        assert main(["solve", str(room), "--out", str(out)]) == 1
        assert str(taken) in capfd.readouterr().err
    assert taken.read_text() == "mine"


def test_interrupt_leaves_nothing(
    scene: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(gtlayout.method, "contact_edges", interrupted)
    assert main(["solve", str(scene), "--rerun", "save"]) == 130
    assert capfd.readouterr().err == "gtlayout: interrupted\n"
    assert not (scene / "gtlayout").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["solve"],
        ["nonsense"],
        ["solve", "x", "--restarts", "0"],
        ["solve", "x", "--seed", "-1"],
        ["solve", "x", "--rerun", "maybe"],
    ],
)
def test_usage_errors_exit_with_2(arguments: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err


def test_export_in_every_format(room: Path, solved: tuple[Path, str], tmp_path: Path) -> None:
    out = solved[0]
    for to, exporter in EXPORTERS.items():
        if exporter.needs is None:
            path = tmp_path / f"{to}_0{exporter.suffix}"
            assert main(["export", str(room), "--to", to, "--layout", str(out), "--out", str(path)]) == 0
            assert path.is_dir() if exporter.suffix == "" else path.stat().st_size > 0
    for name in ("glb", "ply"):
        assert (tmp_path / f"{name}_0.{name}").read_bytes() == (out / f"layout.{name}").read_bytes()


def test_export_goes_beside_the_layout(room: Path, solved: tuple[Path, str], tmp_path: Path) -> None:
    shutil.copy(solved[0] / "layout.json", tmp_path)
    done = run("export", room, "--to", "svg", "--layout", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"Export: {tmp_path / 'floor_plan.svg'}\n", "")
    assert {path.name for path in tmp_path.iterdir()} == {"layout.json", "floor_plan.svg"}


def test_export_without_a_layout_or_format(room: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(room), "--to", "glb", "--layout", str(tmp_path)]) == 1
    assert capfd.readouterr().err.startswith("gtlayout: cannot read")
    assert main(["export", str(room), "--layout", str(tmp_path)]) == 2
    assert main(["export", str(room), "--to", "max", "--layout", str(tmp_path)]) == 2
    assert not list(tmp_path.iterdir())


def test_evaluate_without_a_layout(room: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", str(room), "--layout", str(tmp_path)]) == 1
    assert "layout.json" in capfd.readouterr().err


def test_synth_refuses_a_folder_with_something_in_it(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine").touch()
    assert main(["synth", str(tmp_path)]) == 1
    assert capfd.readouterr().err.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == ["mine"]


def test_version_and_help_load_nothing_heavy() -> None:
    assert run("--version").stdout.strip() == __version__
    assert "layout.json" in run("solve", "--help").stdout
    heavy = "cv2", "gtsam", "pycolmap", "rerun", "scipy", "trimesh"
    code = f"import sys, gtlayout.cli.app; print([m for m in {heavy!r} if m in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "[]"


def test_a_solve_imports_nothing_that_it_does_not_need() -> None:
    """Each of these takes a twentieth to a third of a second."""
    heavy = "av", "jinja2", "pycolmap", "rerun", "scipy.stats", "starlette", "trimesh"
    modules = "gtlayout.api, gtlayout.method, gtlayout.results.tables, gtlayout.review.review"
    code = f"import sys, {modules}; print([m for m in {heavy!r} if m in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "[]"
