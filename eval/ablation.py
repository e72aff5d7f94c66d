"""The rows of the paper's Table 1, for gtlayout's estimator and for the paper's own: same tracks, edges and extents.

The paper: "Estimating Generic 3D Room Structures from 2D Annotations", Rozumnyi et al., NeurIPS 2023.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter
from cyclopts.validators import Number

from common import adam
from common.command_line import Jobs, exit_status, new_app
from common.metrics import Metric, write_tables
from common.plots import per_scene, sigma_against_error
from common.runner import SceneRows, errors_of, find_scenes, run_scenes
from common.scoring import refused, score, summary
from common.table1 import OURS
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.evaluate import evaluate
from gtlayout.extent.extents import compute_extents
from gtlayout.instances import Mesh, Plane
from gtlayout.io.scene_folder import load_scene
from gtlayout.layout import Layout
from gtlayout.method import prepare, solve_planes
from gtlayout.prepared.measurements import Prepared
from gtlayout.quality.assess import assess
from gtlayout.scene import FloatArray

PAPERS = "paper"
RUNS = (1, 10, 30, 100)
ABLATION_SHARE = 0.1
"""Share of the runs that the paper's optimiser gets, at least one, in rows that leave a term out: each takes seconds.
Such a row is to be compared with the full one of as many runs."""
ALL = "all"
"""Folder of the tables of all groups together."""
PLANE = "plane "
"""Rows of a scene that hold no method's score but an element's predicted σ and true error."""

app = new_app("ablation", __doc__)


@dataclass(frozen=True)
class Candidate:
    """One run's layout."""

    layout: Layout
    iou: float
    loss: float


@dataclass(frozen=True)
class Series:
    """Runs of one variant, in order; None for a run without a layout."""

    candidates: tuple[Candidate | None, ...]
    seconds: FloatArray
    """(runs,) of each, from tracks and edges to the IoU."""

    def best(self, count: int, by: Literal["iou", "loss"] = "iou") -> Candidate | None:
        """The best of the first ``count`` runs: of the highest IoU, as in the paper (3.5), or of the lowest loss."""
        found = [c for c in self.candidates[:count] if c is not None]
        return max(found, key=lambda c: c.iou if by == "iou" else -c.loss, default=None)


@app.default
def compare(
    *roots: Annotated[Path, Parameter(name="ROOT")],
    out: Path,
    runs: Annotated[int, Parameter(validator=Number(gte=1, lte=max(RUNS)))] = max(RUNS),
    jobs: Jobs = 1,
) -> None:
    """Solve scenes with both methods and all their variants; write tables and plots.

    Each ROOT, a scene or a folder of scenes, gets a table of its own, several get one of all together as well. A run
    that was cut short goes on where it was.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where tables, plots and the results of each scene go.
    runs
        Runs of each method on random subsets of the tracks; the best IoU counts.
    jobs
        Scenes at a time.
    """
    if not roots:
        raise GtlayoutError("name at least one scene folder, or folder of scene folders")
    scenes_of = {root.resolve().name: find_scenes(root) for root in roots}
    if ALL in scenes_of:
        raise GtlayoutError(f"a folder of scenes cannot be called {ALL!r}: tables of all together go there")
    if len(scenes_of) < len(roots):
        raise GtlayoutError(f"two of the folders have one name: {', '.join(str(root) for root in roots)}")
    together: dict[str, SceneRows] = {}
    failed = 0
    for group, scenes in scenes_of.items():
        folder = out / group
        rows = run_scenes(scenes, folder, partial(measure, runs=runs), f"ablation, {runs} runs", jobs)
        refusals = len(errors_of(scenes, folder))
        write_group(folder, rows, refusals, runs)
        print(f"{group}\n\n{(folder / 'summary.md').read_text(encoding='utf-8')}")
        together |= {f"{group}/{scene}": of for scene, of in rows.items()}
        failed += refusals
    if len(scenes_of) > 1:
        write_group(out / ALL, together, failed, runs)
        print(f"{ALL}\n\n{(out / ALL / 'summary.md').read_text(encoding='utf-8')}")


def measure(folder: Path, runs: int) -> SceneRows:
    """All variants of both methods on one scene, and the predicted σ and true error of each plane of ours.

    Raises GtlayoutError when the scene cannot be read or nothing in it can be tracked.
    """
    config = Config()
    prepared = prepare(load_scene(folder), config)
    rows: SceneRows = {}
    own = run_series(partial(own_planes, prepared, config), prepared, config, runs)
    problem = paper_problem(prepared)
    papers = run_series(partial(paper_planes, problem, adam.AdamConfig()), prepared, config, runs)
    for count in sorted({*(r for r in RUNS if r < runs), runs}):
        rows[f"{OURS}, R = {count}"] = row(prepared, own, count)
        rows[f"{PAPERS}, R = {count}"] = row(prepared, papers, count)
    rows[f"{PAPERS}, R = {runs}, lowest loss"] = row(prepared, papers, runs, by="loss")
    for name, (evidence, settings) in own_ablations(prepared, config).items():
        rows[f"{OURS}, {name}"] = row(
            prepared, run_series(partial(own_planes, evidence, settings), prepared, config, 1), 1
        )
    count = max(1, round(ABLATION_SHARE * runs))
    for name, weights in paper_ablations().items():
        series = run_series(partial(paper_planes, problem, weights), prepared, config, count)
        rows[f"{PAPERS}, R = {count}, {name}"] = row(prepared, series, count)
    return rows | plane_rows(prepared, own.best(1))


def own_planes(prepared: Prepared, config: Config, number: int) -> tuple[tuple[Plane, ...], float]:
    """Run ``number`` of gtlayout's estimator: planes, and its last cost. Raises GtlayoutError when there are none."""
    part = prepared.restarted(config.restart_share, config.seed + number) if number else prepared
    solved = solve_planes(part, config, restart=number)
    return solved.to_world(prepared.form.similarity, prepared.form.anchor).planes, solved.iterations[-1].cost


def paper_problem(prepared: Prepared) -> adam.Problem:
    """What the paper's optimiser makes of the same tracks, instances and edges, in the given world."""
    return adam.problem(
        prepared.given_scene,
        prepared.given_tracks,
        prepared.track_instance,
        prepared.given_instances,
        prepared.edges,
    )


def paper_planes(problem: adam.Problem, config: adam.AdamConfig, number: int) -> tuple[tuple[Plane, ...], float]:
    """Run ``number`` of the paper's optimiser: planes, which know no uncertainty, and the loss."""
    found = adam.run(problem, config, 0, number)
    unknown = np.full((4, 4), np.nan)
    planes = tuple(Plane(row[:3], float(row[3]), unknown, bool(np.isfinite(row).all())) for row in found.planes)
    return planes, found.loss


def own_ablations(prepared: Prepared, config: Config) -> dict[str, tuple[Prepared, Config]]:
    """Name → what is left of the evidence, and the settings. Extents keep all edges."""
    search = replace(config.estimation.initialization, perpendicularity_weight=0.0, manhattan_weight=0.0)
    no_angles = replace(config.estimation, sigma_perpendicularity=1e6, right_angle_reach=0.0, initialization=search)
    no_tracks = np.full_like(prepared.track_instance, -1)
    return {
        "no perpendicularity": (prepared, replace(config, estimation=no_angles)),
        "no edges": (replace(prepared, edges=()), config),
        "no tracks": (replace(prepared, track_instance=no_tracks), config),
    }


def paper_ablations() -> dict[str, adam.AdamConfig]:
    """The same for the paper's optimiser."""
    full = adam.AdamConfig()
    return {
        "no perpendicularity": replace(full, perpendicularity_weight=0.0),
        "no edges": replace(full, edge_weight=0.0),
        "no tracks": replace(full, track_weight=0.0),
    }


def run_series(
    planes_of: Callable[[int], tuple[tuple[Plane, ...], float]], prepared: Prepared, config: Config, runs: int
) -> Series:
    """Stages 5 and 7 after each run."""
    candidates: list[Candidate | None] = []
    seconds = np.zeros(runs)
    for number in range(runs):
        start = time.perf_counter()
        try:
            planes, loss = planes_of(number)
        except GtlayoutError:
            candidates.append(None)
        else:
            scene, instances = prepared.given_scene, prepared.given_instances
            extents = compute_extents(scene, instances, planes, prepared.edges, config.extent)
            quality = assess(scene, instances, planes, extents, config.quality)
            layout = Layout(instances, planes, extents, Mesh.empty(), scene.metric)
            candidates.append(Candidate(layout, quality.iou, loss))
        seconds[number] = time.perf_counter() - start
    return Series(tuple(candidates), seconds)


def row(prepared: Prepared, series: Series, count: int, by: Literal["iou", "loss"] = "iou") -> list[Metric]:
    """The score of the best of so many runs, with the time they took together."""
    best, seconds = series.best(count, by), float(series.seconds[:count].sum())
    return refused(seconds) if best is None else score(evaluate(prepared.given_scene, best.layout), seconds)


def plane_rows(prepared: Prepared, solved: Candidate | None) -> SceneRows:
    """Predicted σ and true error of each plane; nothing where the scene has no unit or no truth."""
    if solved is None or not prepared.given_scene.metric:
        return {}
    return {
        PLANE + plane.truth: [
            Metric("offset_error", plane.offset, "m", False),
            Metric("offset_sigma", plane.sigma_offset, "m", None),
            Metric("normal_error", plane.normal_deg, "°", False),
            Metric("normal_sigma", plane.sigma_normal_deg, "°", None),
        ]
        for plane in evaluate(prepared.given_scene, solved.layout).planes
    }


def write_group(folder: Path, rows: Mapping[str, SceneRows], failed: int, runs: int) -> None:
    """Tables by variant, by scene and by plane, and a plot for each. ``failed`` scenes count as refused by all."""
    methods_of = {scene: {k: v for k, v in of.items() if not k.startswith(PLANE)} for scene, of in rows.items()}
    variants = dict.fromkeys(label for of in methods_of.values() for label in of)
    means = {v: summary([*(of[v] for of in methods_of.values() if v in of), *[refused()] * failed]) for v in variants}
    write_tables(folder, "summary", means, "method")
    scores = {f"{scene}: {v}": metrics for scene, of in methods_of.items() for v, metrics in of.items()}
    write_tables(folder, "scenes", scores, "scene: method")
    planes = {
        f"{scene}: {label.removeprefix(PLANE)}": metrics
        for scene, of in rows.items()
        for label, metrics in of.items()
        if label.startswith(PLANE)
    }
    methods = [f"{OURS}, R = 1", f"{PAPERS}, R = {runs}", f"{PAPERS}, R = {runs}, lowest loss"]
    for key, name, higher, log in (
        ("iou", "IoU", True, False),
        ("depth_error_trimmed", "ε without the worst 1 % of pixels, m", False, True),
    ):
        values = {
            method: {scene: value_of(of[method], key) for scene, of in methods_of.items() if method in of}
            for method in methods
        }
        if np.isfinite([value for of in values.values() for value in of.values()]).any():
            per_scene(folder / f"{key}.png", values, name, higher, log)
    if planes:
        write_tables(folder, "planes", planes, "plane")
        for quantity, unit, name in (("offset", "m", "offset at the centroid"), ("normal", "°", "normal")):
            sigma, error = (
                np.array([value_of(metrics, f"{quantity}_{what}") for metrics in planes.values()])
                for what in ("sigma", "error")
            )
            groups = [label.rsplit(": ", 1)[1].split("_")[0] for label in planes]
            sigma_against_error(folder / f"sigma_{quantity}.png", sigma, error, groups, name, unit)


def value_of(metrics: Sequence[Metric], key: str) -> float:
    """The value of one metric in a row; NaN when it is not there."""
    return next((metric.value for metric in metrics if metric.key == key), np.nan)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
