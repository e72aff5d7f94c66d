"""What is not installed is said in one line that names the extra, and all else works without it."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from gtlayout.extras import MissingExtraError, needs
from gtlayout.io.pixels.video import Video

EXTRAS = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]["optional-dependencies"]
OPTIONAL = {
    *("av", "bokeh", "cvat_sdk", "dask", "distributed", "ezdxf", "ifcopenshell", "jinja2", "pillow_heif", "plotly"),
    *("psutil", "pxr", "pyarrow", "pycolmap", "rerun", "starlette", "torch", "torchvision", "uvicorn"),
}
"""Modules of the packages that only extras install."""
WITHOUT = f"""
import contextlib, io, json, sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {sorted(OPTIONAL)!r}:
            raise ModuleNotFoundError("no module " + name, name=name)
sys.meta_path.insert(0, Missing())
from gtlayout.cli.app import main
found = []
for arguments in json.loads(sys.argv[1]):
    err = io.StringIO()
    with contextlib.redirect_stderr(err), contextlib.redirect_stdout(io.StringIO()):
        status = main(arguments)
    found.append((status, err.getvalue()))
print(json.dumps(found))
"""
"""Runs command lines as if no extra were installed."""


def run_without(*command_lines: list[str]) -> list[tuple[int, str]]:
    """Exit status and stderr of each."""
    ended = subprocess.run(
        [sys.executable, "-c", WITHOUT, json.dumps(command_lines)], capture_output=True, text=True, check=True
    )
    return [(status, err) for status, err in json.loads(ended.stdout)]


def test_the_core_solves_evaluates_and_exports_meshes(room: Path, tmp_path: Path) -> None:
    results = str(tmp_path / "results")
    at = [str(room), "--layout", results]
    exports = [["export", *at, "--to", to] for to in ("glb", "ply", "obj", "svg", "cad-estate", "scenescript")]
    commands = [["solve", str(room), "--out", results], ["evaluate", *at], *exports]
    assert run_without(*commands) == [(0, "")] * len(commands)
    assert {"layout.json", "layout.obj", "floor_plan.svg"} <= {path.name for path in Path(results).iterdir()}


def test_every_other_command_names_its_extra(room: Path, tmp_path: Path) -> None:
    """Before it does anything, in one line, with the exit status of wrong usage."""
    scene, out = str(room), str(tmp_path / "out")
    commands = {
        "annotate": ["annotate", scene],
        "batch": ["batch", scene, "--out", out],
        "colmap": ["import", str(room / "images"), out, "--colmap"],
        "raft": ["solve", scene, "--out", out, "--raft-weights", out],
        "report": ["report", scene, "--out", out],
        "view": ["solve", scene, "--out", out, "--rerun", "save"],
    }
    for (extra, command), (status, err) in zip(commands.items(), run_without(*commands.values()), strict=True):
        assert (status, err.count("\n")) == (2, 1), command
        assert f"pip install 'gtlayout[{extra}]'" in err, err
    assert not list(tmp_path.iterdir())
    ((status, err),) = run_without(["serve", "--label-studio", scene])
    assert (status, "pip install 'gtlayout[annotate]'" in err) == (2, True)


def test_a_distorted_lens_and_a_binary_model_need_pycolmap(tiny: Path) -> None:
    """The whole scene is refused: its frames are not left out one by one."""
    lenses = json.loads((tiny / "transforms.json").read_text())
    (tiny / "transforms.json").write_text(json.dumps({**lenses, "k1": 0.1}))
    ((status, err),) = run_without(["check", str(tiny)])
    assert status == 2
    assert err == (
        "gtlayout: undistorting the lens model OPENCV needs pycolmap, which is not installed: pip install "
        "'gtlayout[colmap]'\n"
    )


def test_errors_within_gtlayout_stay_what_they_are() -> None:
    line = r"^a page needs no_such, which is not installed: pip install 'gtlayout\[page\]'$"
    with pytest.raises(MissingExtraError, match=line), needs("page", "a page"):
        import_module("no_such.part")
    with pytest.raises(ModuleNotFoundError), needs("page"):
        import_module("gtlayout.no_such")


def test_a_video_needs_pyav(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingExtraError, match=r"^reading a video needs av, .*'gtlayout\[video\]'$"):
        _ = Video(tmp_path / "clip.mp4").times_s


def test_all_is_every_extra_of_a_user() -> None:
    (everything,) = EXTRAS["all"]
    assert everything == f"gtlayout[{','.join(sorted(set(EXTRAS) - {'all', 'dev', 'docs', 'eval'}))}]"
