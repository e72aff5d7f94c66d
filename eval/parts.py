"""What each part of the method is worth: scenes solved with one part switched off at a time.

``ablation.py`` leaves out kinds of evidence, in the estimator alone; here whole solves differ.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from common.command_line import Jobs, exit_status, new_app
from common.metrics import markdown_table, write_tables
from common.runner import SceneRows, run_scenes, scenes_by_folder
from common.scoring import refused, score, summary
from common.table1 import OURS
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.evaluate import evaluate
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve

NOTHING, EVERYTHING = 1e-4, 10**6
"""So small a σ leaves no freedom; so many of anything are never found."""

app = new_app("parts", __doc__)


@app.default
def measure(*roots: Annotated[Path, Parameter(name="SCENE")], out: Path, jobs: Jobs = 1) -> None:
    """Solve scenes without one part at a time; write tables. A run that was cut short goes on.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where tables and the results of each scene go.
    jobs
        Scenes at a time.
    """
    scenes = {f"{folder}-{name}": path for folder, of in scenes_by_folder(roots).items() for name, path in of.items()}
    rows = run_scenes(scenes, out, partial(measure_scene, variants=variants(Config())), "parts", jobs)
    write_tables(out, "scenes", {f"{s}: {v}": row for s, of in rows.items() for v, row in of.items()}, "scene: solved")
    means = {name: summary([of[name] for of in rows.values()]) for name in variants(Config())}
    write_tables(out, "summary", means, "solved")
    print(markdown_table(means, "solved"), end="")


def variants(full: Config) -> dict[str, Config]:
    """Name → the settings without one part."""
    estimation = full.estimation
    return {
        OURS: full,
        "no offset of drawn contacts": replace(
            full, estimation=replace(estimation, sigma_contact_offset=NOTHING * estimation.sigma_contact_offset)
        ),
        "no search for camera errors": replace(full, camera_errors=replace(full.camera_errors, min_tracks=EVERYTHING)),
        "no refinement of cameras": replace(full, refine_cameras=False),
        "no regrouping": replace(full, regrouping=replace(full.regrouping, rounds=0)),
        "no wide baselines": replace(full, wide_baseline=replace(full.wide_baseline, min_tracks=EVERYTHING)),
        "no reflections": replace(
            full, estimation=replace(estimation, reflected_share=NOTHING, reflected_prior_tracks=EVERYTHING)
        ),
        "right angles are a law": replace(
            full, estimation=replace(estimation, upright_cauchy=EVERYTHING, right_angle_cauchy=EVERYTHING)
        ),
        "contacts are never wrong": replace(
            full, estimation=replace(estimation, max_contact_px=EVERYTHING, wrong_contact_price=EVERYTHING)
        ),
        "one start": replace(full, estimation=replace(estimation, starts=1)),
    }


def measure_scene(folder: Path, variants: Mapping[str, Config]) -> SceneRows:
    """Name → the score of one scene. Raises GtlayoutError when it cannot be read."""
    scene = load_scene(folder)
    rows: SceneRows = {}
    for name, config in variants.items():
        start = time.process_time()
        try:
            solution = solve(scene, config)
        except GtlayoutError:
            rows[name] = refused(time.process_time() - start)
        else:
            seconds = time.process_time() - start
            # Through the cameras that the planes were solved with, as gtlayout evaluate does.
            rows[name] = score(evaluate(solution.scene, solution.layout), seconds)
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
