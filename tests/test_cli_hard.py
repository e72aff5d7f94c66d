"""The command line misused, cut short, or given what is hostile: one line, the right status, nothing else."""

from __future__ import annotations

import inspect
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import zlib
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import shapely
from rich.console import Console

import gtlayout.method
from gtlayout.api import load_solved
from gtlayout.cli.app import app, main
from gtlayout.evaluation.evaluate import evaluate
from gtlayout.io.scene_folder import load_scene
from gtlayout.limits import ELEMENTS, FILE_MB, FRAMES, IMAGE_MP, Limit
from gtlayout.quality.assess import assess
from gtlayout.quality.config import QualityConfig
from gtlayout.results.tables import evaluation_table, instance_table

Edit = Callable[[Path, Callable[[Any], object]], None]
COMMAND = (sys.executable, "-P", "-m", "gtlayout")
ENDED = {signal.SIGINT: ("interrupted", 130), signal.SIGTERM: ("terminated", 143)}


def run(*arguments: str | Path, **options: Any) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    return subprocess.run([*COMMAND, *arguments], text=True, check=False, **options)


@pytest.fixture(scope="module")
def solved(room: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A solved copy of the room, and what ``--json`` printed."""
    folder, elsewhere = tmp_path_factory.mktemp("hard") / "room", tmp_path_factory.mktemp("elsewhere")
    shutil.copytree(room, folder)
    places = {"HOME": "/nonexistent/home", "TMPDIR": str(elsewhere)}
    environment = {name: value for name, value in os.environ.items() if not name.startswith("XDG_")} | places
    done = run("solve", folder, "--json", env=environment, cwd=elsewhere)
    assert (done.returncode, done.stderr) == (0, "")
    for command in (["report"], ["export", "--to", "svg"]):
        assert run(command[0], folder, *command[1:], env=environment, cwd=elsewhere).returncode == 0
    # Nothing is written but where it was asked for.
    assert not list(elsewhere.iterdir())
    assert not Path("/nonexistent").exists()
    return folder, json.loads(done.stdout)


@pytest.fixture
def scene(solved: tuple[Path, dict[str, Any]], tmp_path: Path) -> Path:
    """A copy of the solved room to break."""
    return Path(shutil.copytree(solved[0], tmp_path / "scene"))


# --- wrong usage


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--versoin"], "unknown option --versoin: did you mean --version?"),
        (["slove", "DIR"], "unknown command slove: did you mean solve?"),
        (["solve", "DIR", "--sead", "1"], "unknown option: --sead. Did you mean --seed?"),
        (["solve", "DIR", "extra"], "one folder too many: extra"),
        (["check", "DIR", "a", "b"], "2 folders too many: a b"),
        (["solve"], "DIR requires an argument"),
    ],
)
def test_usage_is_one_line(arguments: list[str], says: str, room: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main([str(room) if each == "DIR" else each for each in arguments]) == 2
    printed = capfd.readouterr()
    assert printed.out == ""
    assert says in printed.err
    assert printed.err.startswith("gtlayout: ")
    assert printed.err.count("\n") == 1


@pytest.mark.parametrize("command", ["solve", "check", "evaluate", "review", "propose", "report", "annotate"])
def test_a_file_is_no_folder(command: str, room: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main([command, str(room / "scene.json")]) == 1
    assert f"{room / 'scene.json'} is a file, where a folder is wanted" in capfd.readouterr().err


@pytest.mark.parametrize("command", [["solve"], ["export", "--to", "svg"], ["report"], ["propose"], ["batch"]])
def test_out_in_no_folder(
    command: list[str], room: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gtlayout.method, "track", lambda *_, **__: pytest.fail("work was begun"))
    out = tmp_path / "not there/out"
    assert main([command[0], str(room), *command[1:], "--out", str(out)]) == 1
    assert capfd.readouterr().err == f"gtlayout: cannot write {out}: {out.parent} is not there\n"
    assert not out.parent.exists()


def test_every_command_shows_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    names = [name for name in app if not name.startswith("-")]
    assert {"import", "annotate", "check", "solve", "report", "serve", "batch"} <= set(names)
    for name in names:
        assert main([name, "--help"]) == 0
        printed = capsys.readouterr().out
        assert f"Example: gtlayout {name} " in printed
        assert "Exit status: 0 done" in printed
    assert main(["--help"]) == 0
    printed = capsys.readouterr().out
    order = [printed.index(f" {name} ") for name in ("import", "annotate", "check", "solve", "report", "export")]
    assert order == sorted(order)
    assert "--install-completion" in printed


@pytest.mark.parametrize(
    "module", ["annotate", "batch", "export", "import_", "measure", "propose", "review", "serve", "synth"]
)
def test_help_of_a_command_that_is_loaded_late_is_whole(module: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = inspect.getdoc(getattr(import_module(f"gtlayout.cli.{module}"), module))
    assert said is not None
    assert main([module.rstrip("_"), "--help"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    *paragraphs, _ = said.partition("Parameters\n")[0].split("\n\n")
    assert paragraphs
    for paragraph in paragraphs:
        assert " ".join(paragraph.replace("`", "").split()) in printed


# --- what is printed


def test_json_is_all_that_is_printed(solved: tuple[Path, dict[str, Any]], capsys: pytest.CaptureFixture[str]) -> None:
    folder, printed = solved
    quality = json.loads((folder / "gtlayout/quality.json").read_text())
    assert {key: printed[key] for key in quality} == quality
    assert printed["results"] == str(folder / "gtlayout")
    assert printed["dimensions"] == json.loads((folder / "gtlayout/layout.json").read_text())["dimensions"]
    assert main(["check", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 24
    assert main(["evaluate", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["depth"]["median"] < 0.05


def test_what_comes_next(solved: tuple[Path, dict[str, Any]], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(solved[0])]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"next: gtlayout solve {solved[0]}"


def test_output_that_cannot_be_taken(solved: tuple[Path, dict[str, Any]]) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("needs /dev/full")
    with Path("/dev/full").open("w") as full:
        for arguments in (["evaluate", solved[0]], ["--help"]):
            done = run(*arguments, stdout=full)
            assert (done.returncode, done.stderr) == (1, "gtlayout: cannot print: No space left on device\n")


def test_ascii_output(solved: tuple[Path, dict[str, Any]]) -> None:
    done = run("evaluate", solved[0], env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.isascii()
    assert "sigma of depth" in done.stdout


def test_narrow_tables_leave_columns_out(solved: tuple[Path, dict[str, Any]]) -> None:
    scene, layout = load_solved(solved[0])
    quality = assess(scene, layout.instances, layout.planes, layout.extents, QualityConfig())
    names = {width: [str(c.header) for c in instance_table(layout, quality, width).columns] for width in (30, 60, None)}
    assert names[None] == ["instance", "area", "frames", "tracks", "σ normal", "σ depth", "LOA", "IoU", "verdict"]
    assert names[60] == ["instance", "area", "tracks", "σ normal", "σ depth", "LOA", "IoU", "verdict"]
    assert names[30] == ["instance", "σ depth", "verdict"]


# --- cut short


@pytest.mark.parametrize("number", ENDED)
@pytest.mark.parametrize("after_s", [0.4, 1.2])
def test_signals_are_one_line(number: signal.Signals, after_s: float, room: Path, tmp_path: Path) -> None:
    """During the first imports, those of OpenCV and pycolmap, and the solve."""
    command = [*COMMAND, "solve", str(room), "--out", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        time.sleep(after_s)
        process.send_signal(number)
        out, err = process.communicate()
    word, status = ENDED[number]
    assert (process.returncode, out, err) == (status, "", f"gtlayout: {word}\n")
    assert not list(tmp_path.iterdir())


def test_ctrl_c_before_the_first_import_is_one_line() -> None:
    """What answers Ctrl-C is imported, too."""
    program = (
        "import os, signal, sys\n"
        "class Interrupts:\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        if name == 'gtlayout.signals':\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupts())\n"
        "from gtlayout.__main__ import main\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "gtlayout: interrupted\n")


def test_a_time_limit_says_what_was_reached(room: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["solve", str(room), "--out", str(tmp_path / "out"), "--timeout", "0.2"]) == 1
    err = capfd.readouterr().err
    assert err.startswith("gtlayout: not done in 0.2 s: stopped in ")
    assert err.removeprefix("gtlayout: not done in 0.2 s: stopped in ") in (
        "reading, nothing was written\n",
        "tracking, nothing was written\n",
    )
    assert not list(tmp_path.iterdir())
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0


# --- hostile files


@pytest.mark.parametrize("digits", [20, 350, 500])
@pytest.mark.parametrize(
    ("name", "put"),
    [
        ("gt_planes.json", lambda d, n: next(iter(d["planes"].values())).update(d=n)),
        ("gt_planes.json", lambda d, n: next(iter(d["planes"].values())).update(normal=[n, 0, 0])),
        ("gtlayout/layout.json", lambda d, n: d["instances"][0]["plane"].update(d=n)),
        ("gtlayout/layout.json", lambda d, n: d["instances"][0]["plane"]["support"].update(tracks=n)),
        ("gtlayout/layout.json", lambda d, n: d["instances"][0]["extent"]["polygons"][0][0][0].__setitem__(0, n)),
        ("gtlayout/layout.json", lambda d, n: d["mesh"]["faces"][0].__setitem__(0, n)),
    ],
)
def test_long_numbers(
    name: str,
    put: Callable[[Any, object], object],
    digits: int,
    scene: Path,
    edit_json: Edit,
    capfd: pytest.CaptureFixture[str],
) -> None:
    edit_json(scene / name, lambda data: put(data, "LONG"))
    text = (scene / name).read_text().replace('"LONG"', "9" * digits)
    (scene / name).write_text(text)
    assert main(["evaluate", str(scene)]) == 1
    err = capfd.readouterr().err
    assert err.startswith("gtlayout: ")
    assert name in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("jag_px", "count", "says"),
    [(0.3, 10_000, "made coarser"), (15.0, 10_000, "dropped: draw it with fewer"), (0.001, 40_000, "made coarser")],
)
def test_polygons_of_too_many_points(jag_px: float, count: int, says: str, tiny: Path, edit_json: Edit) -> None:
    """Repairing the first took 6 s and the second gigabytes."""
    corners = np.array([[5.0, 5], [60, 5], [60, 40], [5, 40]])
    t = np.linspace(0, 1, count // 4, endpoint=False)[:, None]
    line = np.concatenate([a * (1 - t) + b * t for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    number = np.arange(count)
    line += jag_px * np.column_stack([np.sin(1.7 * number), np.cos(1.3 * number)])
    edit_json(tiny / "annotations.json", lambda d: d["frames"][0]["elements"][0].update(polygons=[line.tolist()]))
    start_s = time.process_time()
    scene = load_scene(tiny)
    assert time.process_time() - start_s < 3
    assert any(says in line for line in scene.warnings)
    if says == "made coarser":
        (element,) = scene.key_frames[0].elements
        assert element.amodal.area == pytest.approx(55 * 35, rel=0.05)
        assert shapely.get_num_coordinates(element.amodal) < 100


@pytest.mark.parametrize("limit", [FRAMES, FILE_MB, ELEMENTS, IMAGE_MP])
def test_limits_are_named(
    limit: Limit, tiny: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(limit.variable, "0")
    assert main(["check", str(tiny)]) == (3 if limit is IMAGE_MP else 1)
    printed = capfd.readouterr()
    assert f"more than 0 {limit.what}: set {limit.variable} to read more" in printed.out + printed.err


def test_a_bomb_is_not_unpacked(tiny: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A hundred bytes that claim 900 megapixels."""
    png = bytearray(cv2.imencode(".png", np.zeros((64, 64), np.uint8))[1].tobytes())
    png[16:24] = (30_000).to_bytes(4, "big") * 2
    png[29:33] = zlib.crc32(png[12:29]).to_bytes(4, "big")
    image = tiny / "images/002.png"
    image.write_bytes(png)
    assert main(["check", str(tiny)]) == 3
    printed = capfd.readouterr()
    assert f"cannot read image {image}: more than 128 megapixels: set GTLAYOUT_MAX_IMAGE_MP" in printed.out
    assert printed.err == ""


def test_libraries_write_no_lines_of_their_own(tiny: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tiny / "images/002.png").write_bytes(b"GIF89a" + bytes(range(1, 250)) * 9)
    image = tiny / "images/003.png"
    image.write_bytes(image.read_bytes()[:-2000])
    assert main(["check", str(tiny)]) == 3
    printed = capfd.readouterr()
    assert printed.err == ""
    for name in ("002.png", "003.png"):
        assert f"cannot read image {tiny / 'images' / name}: damaged, or not an image" in printed.out


def test_scene_and_layout_are_one_line(solved: tuple[Path, dict[str, Any]]) -> None:
    scene, layout = load_solved(solved[0])
    assert repr(scene) == f"<Scene {solved[0]}: 24 frames, 3 key frames, 17 elements, metric>"
    assert repr(layout) == "<Layout: 7 instances (1 floor, 1 ceiling, 3 wall, 1 door, 1 window), metric>"


def test_notebooks_show_a_table_of_the_scene_and_of_the_layout(solved: tuple[Path, dict[str, Any]]) -> None:
    scene, layout = load_solved(solved[0])
    shown = scene._repr_html_()
    assert shown.startswith(f"<p>Scene {solved[0]}: 24 frames, 3 key frames, 17 elements, metric</p><table>")
    assert shown.count("<tr>") == 1 + 3
    counts = [int(number) for number in re.findall(r"<td>(\d+)</td>", shown)]
    assert sum(counts) == 17
    shown = layout._repr_html_()
    assert shown.count("<tr>") == 1 + 7
    assert f"<td>floor_0</td><td>{layout.extents[0].region.area:.2f} m²</td>" in shown
    lost = replace(layout.planes[0], observable=False)
    assert "<td>floor_0</td><td>unobservable</td>" in replace(layout, planes=(lost, *layout.planes[1:]))._repr_html_()
    hostile = replace(scene, root=Path("<script>"))._repr_html_()
    assert "<script>" not in hostile
    assert "&lt;script" in hostile


def test_narrow_terminals_cut_no_value_of_an_evaluation(solved: tuple[Path, dict[str, Any]]) -> None:
    evaluation = evaluate(*load_solved(solved[0]))
    texts = {}
    for width in (40, 200):
        console = Console(width=width, file=io.StringIO(), force_jupyter=False, highlight=False, soft_wrap=True)
        console.print(evaluation_table(evaluation))
        assert isinstance(console.file, io.StringIO)
        texts[width] = sorted(re.findall(r"[\w.]+", console.file.getvalue()))
    assert texts[40] == texts[200]
