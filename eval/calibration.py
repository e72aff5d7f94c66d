"""Calibration: do planes lie off the true ones by as much as gtlayout says they may?"""

from __future__ import annotations

import csv
import io
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, zip_longest
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from benchmark_rooms import LEVELS
from common.command_line import Jobs, exit_status, new_app
from common.consistency import PLANE_DOF, coverage, nees, plane_error_at, rank_correlation, share_of
from common.metrics import Metric, write_tables
from common.plots import reliability, sigma_against_error
from common.runner import SceneRows, errors_of, run_scenes, scenes_by_folder
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.instance_scores import centroid_world, match_instances, plane_error
from gtlayout.geometry.depth import centroid_of_largest
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.raster import spread_points
from gtlayout.instances import Plane
from gtlayout.io.files import write_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import Truth, read_truth
from gtlayout.method import solve
from gtlayout.scene import OPENINGS, Camera, FloatArray, Scene
from gtlayout.solution import Solution

NOMINAL = (0.5, 0.9, 0.95)
WRONG_M = 0.1
"""A plane that is farther off than this at the centroid of its instance is badly wrong."""
SURE_M = 0.05
"""A plane that is badly wrong with a σ below this and the verdict "ok" gives no warning."""
PIXELS = 12
"""Points sampled on each element."""
TEXTS = ("scene", "kind", "level", "plane", "label", "verdict", "note")
"""First columns of the table of planes."""
FAILED, MISSING, UNOBSERVABLE = "failed", "missing", "unobservable"
"""In the column of verdicts: a scene without a layout, a true plane that no instance stands for, one that nothing but
priors places."""

app = new_app("calibration", __doc__)


@dataclass(frozen=True)
class Row:
    """A true plane, or a scene that failed."""

    scene: str
    kind: str
    """Camera path of the benchmark's rooms; of other scenes the folder that they lie in."""
    level: str
    """Of the benchmark's rooms, else empty."""
    plane: str
    label: str
    verdict: str
    """Of the instance that stands for the plane."""
    note: str = ""
    """Why the scene failed."""
    metrics: tuple[Metric, ...] = ()

    def value(self, key: str) -> float:
        """One of the metrics; NaN when it is not there."""
        return next((metric.value for metric in self.metrics if metric.key == key), np.nan)

    @property
    def groups(self) -> tuple[str, ...]:
        """Rows of the summary that it counts in, coarse to fine. Nothing is known of a failed scene's labels."""
        whole = ("rooms", self.kind, self.level, f"{self.kind}, {self.level}") if self.level else (self.kind,)
        if not self.label:
            return whole
        of_class = "openings" if self.label in OPENINGS else "room surfaces"
        return (*whole, *(f"{group}, {of_class}" for group in whole[:2]))


@app.default
def calibrate(*roots: Annotated[Path, Parameter(name="SCENE")], out: Path, jobs: Jobs = 1) -> None:
    """Solve scenes with default settings and compare each plane with the true one, in σ of its own covariance.

    Scenes need gt_planes.json. Those in a folder that benchmark_rooms.py made are grouped by camera path and level,
    others by the folder that they lie in. A run that was cut short goes on where it was.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where tables, plots and the results of each scene go.
    jobs
        Scenes at a time.
    """
    rows: list[Row] = []
    for folder, scenes in scenes_by_folder(roots).items():
        results = run_scenes(scenes, out / folder, measure, f"calibration: {Config()!r}", jobs)
        errors = errors_of(scenes, out / folder)
        rows += [row for name in scenes for row in rows_of(folder, name, results.get(name), errors.get(name))]
    write(out, rows)
    print((out / "summary.md").read_text(encoding="utf-8"))
    print(f"Results: {out}")


def measure(folder: Path) -> SceneRows:
    """``plane|label|verdict`` → what is off, and what was predicted, for each true plane that was measured.

    Raises GtlayoutError when the scene cannot be read or solved, or has no truth.
    """
    scene = load_scene(folder)
    truth = read_truth(scene)
    if truth is None:
        raise GtlayoutError(f"{folder}: no gt_planes.json, so nothing to compare planes with")
    return compare(solve(scene, Config()), truth)


def compare(solution: Solution, truth: Truth) -> SceneRows:
    """The same for a layout that is there already."""
    layout, judged = solution.layout, solution.quality.instances
    match = match_instances(layout, truth)
    rows: SceneRows = {}
    for name, true in truth.planes.items():
        if not true.scored:
            continue
        index = match.get(name)
        if index is None:
            rows[f"{name}|{_drawn_label(solution.scene, truth, name)}|{MISSING}"] = []
            continue
        label, verdict = layout.instances[index].label, judged[index].verdict
        known = verdict != UNOBSERVABLE
        rows[f"{name}|{label}|{verdict}"] = plane_metrics(solution, truth, name, index) if known else []
    return rows


def plane_metrics(solution: Solution, truth: Truth, name: str, index: int) -> list[Metric]:
    """Errors of instance ``index``, which stands for the true plane ``name``, and their σ.

    Lengths are left out of scenes without a unit; ratios and shares are not.
    """
    scene, layout, true = solution.scene, solution.layout, truth.planes[name]
    plane, instance = layout.planes[index], layout.instances[index]
    off = plane_error(layout, index, name, true)
    squared = nees(*plane_error_at(plane, true.normal, true.d, centroid_world(layout.extents[index])))
    true_plane = Plane(true.normal, true.d, np.full((4, 4), np.nan), observable=True)
    at_centroid = depth_errors(plane, true_plane, *centroid_of_largest(scene, instance))[0]
    drawn = np.concatenate(
        [
            depth_errors(
                plane,
                true_plane,
                scene.frame_of(k).camera,
                spread_points(scene.key_frames[k].elements[element].amodal, PIXELS),
            )
            for k, element in instance.members
        ]
    )
    over_drawn = _means(drawn)
    unit = 1.0 if scene.metric else np.nan
    return [
        Metric("nees", squared, "", None),
        Metric("normal_error", off.normal_deg, "°", False),
        Metric("normal_sigma", off.sigma_normal_deg, "°", None),
        Metric("offset_error", unit * off.offset, "m", False),
        Metric("offset_sigma", unit * off.sigma_offset, "m", None),
        Metric("depth_error", unit * at_centroid[0], "m", False),
        Metric("depth_sigma", unit * at_centroid[1], "m", None),
        Metric("depth_error_share", at_centroid[2], "", False),
        Metric("depth_sigma_share", at_centroid[3], "", None),
        Metric("drawn_depth_error", unit * over_drawn[0], "m", False),
        Metric("drawn_depth_sigma", unit * over_drawn[1], "m", None),
        Metric("normal_ratio", off.normal_deg / off.sigma_normal_deg, "", None),
        Metric("offset_ratio", off.offset / off.sigma_offset, "", None),
    ]


def depth_errors(plane: Plane, true: Plane, camera: Camera, points_px: FloatArray) -> FloatArray:
    """(N, 4) of (N, 2) pixels: absolute error of the depth, its σ, both in world units, and both as shares.

    Shares are of the true depth for the error, of the plane's own for σ. NaN where a ray misses the plane, and for the
    absolute error where it misses the true one.
    """
    homogeneous = np.column_stack([points_px, np.ones(len(points_px))])
    inverse, true_inverse = (homogeneous @ inverse_depth(of, camera) for of in (plane, true))
    rays = camera.rays_world(points_px)
    found = np.full((len(points_px), 4), np.nan)
    for i in np.nonzero(inverse > 0)[0]:
        depth = 1 / inverse[i]
        sigma = plane.sigma_depth(camera.center_world + depth * rays[i], rays[i])
        error = abs(depth - 1 / true_inverse[i]) if true_inverse[i] > 0 else np.nan
        found[i] = error, sigma, abs(depth * true_inverse[i] - 1), sigma / depth
    return found


def rows_of(folder: str, name: str, measured: SceneRows | None, error: str | None) -> list[Row]:
    """The rows of one scene; one that says so when it failed."""
    kind, _, level = folder.rpartition("-")
    if level not in LEVELS:
        kind, level = folder, ""
    scene = f"{folder}/{name}"
    if measured is None:
        return [Row(scene, kind, level, "", "", FAILED, note=error or "")]
    rows = []
    for key, metrics in measured.items():
        plane, label, verdict = key.rsplit("|", 2)
        rows.append(Row(scene, kind, level, plane, label, verdict, metrics=tuple(metrics)))
    return rows


def summary_rows(rows: Sequence[Row]) -> dict[str, list[Metric]]:
    """Group → what its planes say together; coarse groups first."""
    return {group: summary_row([row for row in rows if group in row.groups]) for group in _groups(rows)}


def summary_row(rows: Sequence[Row]) -> list[Metric]:
    """What the planes of one group say together."""
    known = [row for row in rows if row.metrics]
    squared = column(known, "nees")
    squared = squared[np.isfinite(squared)]
    wrong = [row for row in known if row.value("offset_error") > WRONG_M]
    sure = [row for row in wrong if row.value("offset_sigma") < SURE_M and row.verdict == "ok"]
    ranks = {
        what: rank_correlation(column(known, sigma), column(known, error))
        for what, sigma, error in (
            ("depth", "depth_sigma", "depth_error"),
            ("depth_share", "depth_sigma_share", "depth_error_share"),
            ("drawn_depth", "drawn_depth_sigma", "drawn_depth_error"),
        )
    }
    return [
        Metric("scenes", len({row.scene for row in rows}), "", None),
        Metric("failed", sum(row.verdict == FAILED for row in rows), "", False),
        Metric("missing", sum(row.verdict == MISSING for row in rows), "", False),
        Metric("unobservable", sum(row.verdict == UNOBSERVABLE for row in rows), "", None),
        Metric("planes", len(known), "", None),
        Metric("nees_mean", float(squared.mean()) if len(squared) else np.nan, "", None),
        Metric("nees_median", float(np.median(squared)) if len(squared) else np.nan, "", None),
        *(Metric(f"coverage_{100 * p:.0f}", coverage(squared, p).value, "", None) for p in NOMINAL),
        *(Metric(f"rank_{what}", value, "", True) for what, value in ranks.items()),
        *(
            Metric(f"{of}_ratio_{100 * p:.0f}", _quantile(column(known, f"{of}_ratio"), p), "", None)
            for of in ("offset", "normal")
            for p in (0.5, 0.9)
        ),
        Metric("badly_wrong", len(wrong), "", False),
        Metric("wrong_and_sure", len(sure), "", False),
        Metric("wrong_and_sure_share", share_of(len(sure), len(wrong)).value, "", False),
    ]


def coverage_rows(rows: Sequence[Row]) -> dict[str, list[Metric]]:
    """Group → share of its planes in each ellipsoid, with the ends of its 95 % interval."""
    table = {}
    for group in _groups(rows):
        squared = column([row for row in rows if group in row.groups], "nees")
        table[group] = [Metric("planes", float(np.count_nonzero(np.isfinite(squared))), "", None)]
        for nominal in NOMINAL:
            share, key = coverage(squared, nominal), f"coverage_{100 * nominal:.0f}"
            table[group] += [
                Metric(key, share.value, "", None),
                Metric(f"{key}_low", share.low, "", None),
                Metric(f"{key}_high", share.high, "", None),
            ]
    return table


def write(out_dir: Path, rows: Sequence[Row]) -> None:
    """Tables by plane and by group, and the plots. Raises GtlayoutError when the disk does not take them."""
    write_atomic(out_dir / "planes.csv", planes_csv(rows))
    write_tables(out_dir, "summary", summary_rows(rows), "group")
    write_tables(out_dir, "coverage", coverage_rows(rows), "group")
    kinds = list(dict.fromkeys(row.kind for row in rows))
    by_kind = {kind: [row for row in rows if row.kind == kind and row.metrics] for kind in kinds}
    reliability(out_dir / "reliability.png", {kind: column(of, "nees") for kind, of in by_kind.items()}, PLANE_DOF)
    for kind, of in by_kind.items():
        sigma, error = column(of, "depth_sigma"), column(of, "depth_error")
        sigma_against_error(out_dir / f"sigma_depth_{kind}.png", sigma, error, [row.label for row in of], "depth", "m")


def planes_csv(rows: Sequence[Row]) -> str:
    """A line per true plane, or failed scene; empty where there is no value."""
    names = dict.fromkeys(_heading(metric) for row in rows for metric in row.metrics)
    text = io.StringIO()
    table = csv.DictWriter(text, [*TEXTS, *names], restval="", lineterminator="\n")
    table.writeheader()
    for row in rows:
        numbers = {_heading(m): repr(float(m.value)) for m in row.metrics if np.isfinite(m.value)}
        table.writerow({name: getattr(row, name) for name in TEXTS} | numbers)
    return text.getvalue()


def column(rows: Sequence[Row], key: str) -> FloatArray:
    """(rows,) values of one metric; NaN where a row has none."""
    return np.array([row.value(key) for row in rows], dtype=np.float64)


def _groups(rows: Sequence[Row]) -> list[str]:
    """All groups, those of the benchmark's rooms before others, coarse before fine."""
    rooms, others = ([row.groups for row in rows if bool(row.level) is known] for known in (True, False))
    coarse_first = chain(*zip_longest(*rooms), *zip_longest(*others))
    return [group for group in dict.fromkeys(coarse_first) if group is not None]


def _heading(metric: Metric) -> str:
    return metric.key + (f"_{metric.unit}" if metric.unit else "")


def _quantile(values: FloatArray, share: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, share)) if len(known) else np.nan


def _means(values: FloatArray) -> FloatArray:
    """(C,) mean of each column over the rows that are known throughout; NaN of none."""
    known = values[np.isfinite(values).all(axis=1)]
    return known.mean(axis=0) if len(known) else np.full(values.shape[1], np.nan)


def _drawn_label(scene: Scene, truth: Truth, name: str) -> str:
    """Label under which a true plane was drawn, most often; empty when it was not drawn."""
    drawn = Counter(scene.key_frames[k].elements[e].label for (k, e), of in truth.elements.items() if of == name)
    return drawn.most_common(1)[0][0] if drawn else ""


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
