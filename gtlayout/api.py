"""Read scenes and results from folders, and write results: before and after ``gtlayout.solve``."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from gtlayout.io.scene_folder import load_scene
from gtlayout.layout import Layout
from gtlayout.results.evidence import evidence_of
from gtlayout.results.layout_files import write_results
from gtlayout.results.layout_reader import read_solved
from gtlayout.results.names import FOLDER
from gtlayout.review.findings import Finding
from gtlayout.scene import Scene
from gtlayout.solution import Solution

AnyPath = str | PathLike[str]


def load(folder: AnyPath, *, cameras: AnyPath | None = None, annotations: AnyPath | None = None) -> Scene:
    """Read a scene folder: cameras, images, annotations, in any known format.

    ``cameras`` and ``annotations`` are the file or folder to read, as a path or within ``folder``, where there are
    several or they lie elsewhere.

    Raises GtlayoutError, one line that names the file, when something is missing, ambiguous or cannot be repaired.
    ``Scene.warnings`` lists what was repaired or skipped.
    """
    return load_scene(Path(folder), _path(annotations), cameras=_path(cameras))


def load_solved(
    folder: AnyPath,
    results: AnyPath | None = None,
    *,
    cameras: AnyPath | None = None,
    annotations: AnyPath | None = None,
) -> tuple[Scene, Layout]:
    """Read a scene folder and its solved layout, from ``results`` (``folder/gtlayout`` when not given).

    ``cameras`` and ``annotations`` are those of ``load`` when the scene was solved. The scene has the cameras that the
    layout was solved with, also when these were corrected or refined. Raises
    GtlayoutError when either cannot be read, or the layout was made from other annotations.
    """
    found = Path(folder) / FOLDER if results is None else Path(results)
    return read_solved(load(folder, cameras=cameras, annotations=annotations), found)


def save(solution: Solution, results: AnyPath, findings: Sequence[Finding] | None = None) -> None:
    """Write a solution: layout.json, .glb and .ply, quality.json, config.json, evidence.json and timings.json.

    With new cameras also cameras.json; ``findings`` of a review of the solution are written to review.json.

    Raises GtlayoutError when the files cannot be written to the folder ``results``. All its files are then unchanged.
    """
    write_results(
        Path(results),
        solution.scene,
        solution.layout,
        solution.quality,
        solution.config,
        new_cameras=solution.new_cameras,
        timings_s=solution.timings_s,
        findings=findings,
        evidence=evidence_of(solution),
    )


def _path(given: AnyPath | None) -> Path | None:
    return None if given is None else Path(given)
