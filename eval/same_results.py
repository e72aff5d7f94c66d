"""Whether a change of the code leaves results alone: what ``gtlayout solve`` writes, byte by byte, before and after."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from common.command_line import GTLAYOUT, Jobs, exit_status, new_app
from common.runner import scenes_by_folder
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json
from gtlayout.processes import single_threaded

FILES = ("layout.json", "layout.ply", "layout.glb", "quality.json")
RENAMED: dict[str, dict[str, str]] = {
    "layout.json": {"elements": "instances", "face_element": "face_instance", "held_by": "dominant_evidence"},
}
"""Keys that have other names since the results to compare with were made: file → earlier → now."""
REWORDED: dict[str, str] = {
    "gtlayout-layout/3": "gtlayout-layout/4",
    "largest of the elements that share": "largest of the instances that share",
    r"(\d+ of \d+) elements, ": r"\1 instances, ",
    "all elements are ok": "all instances are ok",
    "no element is ok": "no instance is ok",
    "look at drawings and camera of": "look at the elements and the camera of",
    "drawings were scaled": "their shapes were scaled",
    "a polyline is no surface": "a polyline encloses no area",
    "nothing of it is left before surfaces with a higher z-order": "elements with a higher z-order cover all of it",
}
"""Parts of texts in JSON files that have other words since then: regular expression → what replaces it."""

app = new_app("same_results", __doc__)


@app.command
def make(*roots: Annotated[Path, Parameter(name="SCENE")], out: Path, jobs: Jobs = 1) -> None:
    """Solve scenes and keep the results.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        A folder for the results of each scene.
    jobs
        Scenes solved at a time.
    """
    by_folder = scenes_by_folder(roots)
    scenes = [(path, out / folder / name) for folder, found in by_folder.items() for name, path in found.items()]
    for _, results in scenes:
        results.parent.mkdir(parents=True, exist_ok=True)
    with single_threaded(), ThreadPoolExecutor(jobs) as pool:
        for (path, _), problem in zip(scenes, pool.map(_solve, scenes), strict=True):
            print(f"{path}: {problem or 'solved'}")


@app.command
def compare(before: Path, after: Path) -> None:
    """Compare two such folders; scenes that differ are a known problem.

    Parameters
    ----------
    before, after
        Folders that ``make`` wrote.
    """
    names = sorted({path.relative_to(root).parent for root in (before, after) for path in root.glob(f"*/*/{FILES[0]}")})
    if not names:
        raise GtlayoutError(f"no results in {before} and {after}")
    different = [
        str(name / file)
        for name in names
        for file in FILES
        if _digest(before / name / file) != _digest(after / name / file)
    ]
    if different:
        raise GtlayoutError(f"{len(different)} of {len(names) * len(FILES)} files differ: {', '.join(different)}")
    print(f"{len(names)} scenes, {len(names) * len(FILES)} files: all the same")


def _solve(scene_and_out: tuple[Path, Path]) -> str:
    """What went wrong; empty when nothing did. In a process of its own: results must not hang on what went before."""
    scene, out = scene_and_out
    ran = subprocess.run(
        [*GTLAYOUT, "solve", str(scene), "--out", str(out)], capture_output=True, text=True, check=False
    )
    return "" if ran.returncode == 0 else ran.stderr.strip()


def _digest(file: Path) -> str:
    """Of a file's bytes, with the words of today in JSON; "missing" for a file that is not there."""
    if not file.is_file():
        return "missing"
    if file.suffix != ".json":
        return hashlib.sha256(file.read_bytes()).hexdigest()
    content = json.dumps(_in_words_of_today(read_json(file), RENAMED.get(file.name, {})))
    return hashlib.sha256(content.encode()).hexdigest()


def _in_words_of_today(value: Any, renamed: Mapping[str, str]) -> Any:
    if isinstance(value, dict):
        return {renamed.get(key, key): _in_words_of_today(inner, renamed) for key, inner in value.items()}
    if isinstance(value, list):
        return [_in_words_of_today(inner, renamed) for inner in value]
    if isinstance(value, str):
        for earlier, now in REWORDED.items():
            value = re.sub(earlier, now, value)
    return value


def main(arguments: list[str] | None = None) -> int:
    """Run the command line."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
