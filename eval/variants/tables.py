"""All variants of all scenes: measured or taken from an earlier run, and their tables and plot."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from common.metrics import Metric, csv_table, markdown_table, mean_over, write_tables
from common.plots import by_variant
from common.runner import SceneRows, Task, errors_of, run_tasks, scenes_by_folder
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import write_all_atomic
from gtlayout.io.scene_folder import load_scene
from measure_variant import VARIANTS, measured_apart
from variants.measures import WHOLE

COUNTS = ("failed", "planes", "missing", "off", "wrong_and_certain", "right", "elements", "warnings")
"""Columns that a summary adds up."""
MEANS = ("iou", "accepted", "trustworthy", "within_5cm", "within_10cm", "time", "peak_memory")
"""Columns of which the summary has the mean."""
WORST = {"iou": min, "depth_error_trimmed": max}
"""Columns of which the summary has the worst."""
UNREADABLE = "unreadable"
"""In place of its variants, for a scene that cannot be read or has no truth."""
ROWS, SUMMARY, CERTAIN, FAILED = "rows", "summary", "wrong_and_certain", "failed"


@dataclass(frozen=True)
class Outcome:
    """One variant of one scene."""

    scene: str
    variant: str
    rows: SceneRows
    """As ``variant_measures`` has them; empty when it failed."""
    error: str = ""
    """Why it failed."""

    @property
    def label(self) -> str:
        """Of its row."""
        return f"{self.scene}: {self.variant}"

    @property
    def whole(self) -> list[Metric]:
        """Its figures; a variant that gave no layout is not accepted and has IoU 0."""
        if self.error:
            return [Metric("failed", 1.0, "", False), Metric("iou", 0.0, "", True), Metric("accepted", 0.0, "", True)]
        return self.rows[WHOLE]

    def value(self, key: str) -> float:
        """One of its figures; NaN when it is not there."""
        return _value(self.whole, key)


def run(
    kind: str, roots: Sequence[Path], out: Path, jobs: int, chosen: Callable[[Sequence[str]], Sequence[str]]
) -> list[Outcome]:
    """Measure the variants of all scenes in ``roots``, each in a process of its own, or take what is there already.

    Args:
        kind: one of ``VARIANTS``.
        out: folder of the results.
        jobs: variants at a time.
        chosen: those of the variants' names to measure.

    Raises:
        GtlayoutError: results cannot be written.
    """
    outcomes: list[Outcome] = []
    for folder, scenes in scenes_by_folder(roots).items():
        tasks: dict[str, Task] = {}
        rows: list[tuple[str, str, str]] = []
        unreadable: dict[str, str] = {}
        for scene, path in scenes.items():
            try:
                names = list(VARIANTS[kind](load_scene(path)))
            except GtlayoutError as error:
                unreadable[scene] = str(error)
                rows.append((scene, UNREADABLE, scene))
                continue
            for name in chosen(names):
                file = file_name(scene, name)
                tasks[file] = Task(path, partial(measured_apart, kind, path, name), f"{kind} {name} {Config()!r}")
                rows.append((scene, name, file))
        results = run_tasks(tasks, out / folder, jobs)
        errors = errors_of(tasks, out / folder) | unreadable
        # A table that others read says nothing of where the scenes lay.
        reason = {file: errors.get(file, "").replace(str(scenes[scene]), scene) for scene, _, file in rows}
        outcomes += [
            Outcome(f"{folder}/{scene}", name, results.get(file, {}), reason[file]) for scene, name, file in rows
        ]
    return outcomes


def write(out: Path, outcomes: Sequence[Outcome], kind_of: Callable[[str], str]) -> None:
    """Tables by variant, by kind of variant, of what is wrong and certain and of what failed; and the plot."""
    write_tables(out, ROWS, {outcome.label: outcome.whole for outcome in outcomes}, "scene: variant")
    kinds = dict.fromkeys(kind_of(outcome.variant) for outcome in outcomes)
    summary = {kind: summarised([of for of in outcomes if kind_of(of.variant) == kind]) for kind in kinds}
    write_tables(out, SUMMARY, {**summary, "all": summarised(outcomes)}, "variant")
    write_tables(out, CERTAIN, wrong_and_certain(outcomes), "scene: variant: true plane = instance")
    planes = {f"{of.label}: {key}": metrics for of in outcomes for key, metrics in of.rows.items() if key != WHOLE}
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(
        [("scene", "variant", "reason"), *((of.scene, of.variant, of.error) for of in outcomes if of.error)]
    )
    write_all_atomic(
        {
            out / f"{FAILED}.csv": text.getvalue(),
            out / "planes.csv": csv_table(planes, "scene: variant: true plane|instance|verdict"),
        }
    )
    plotted = {
        title: {
            scene: [(kind_of(of.variant), of.value(key)) for of in outcomes if of.scene == scene]
            for scene in dict.fromkeys(of.scene for of in outcomes)
        }
        for key, title in (
            ("iou", "IoU"),
            ("within_10cm", "share of pixels within 10 cm"),
            ("wrong_and_certain", "planes wrong and certain"),
        )
    }
    by_variant(out / "variants.png", plotted, list(kinds))


def summarised(outcomes: Sequence[Outcome]) -> list[Metric]:
    """What some variants come to together: sums of counts, means, and the worst."""
    rows = [outcome.whole for outcome in outcomes]
    means = {metric.key: metric for metric in mean_over(sorted(rows, key=len, reverse=True))}
    columns = [Metric("variants", float(len(rows)), "", None)]
    for key, metric in means.items():
        values = np.array([_value(row, key) for row in rows])
        known = values[np.isfinite(values)]
        if key in COUNTS:
            columns.append(Metric(key, float(known.sum()), metric.unit, metric.higher_is_better))
        if key in MEANS:
            columns.append(metric)
        if key in WORST:
            worst = float(WORST[key](known)) if len(known) else np.nan
            columns.append(Metric(f"{key}_worst", worst, metric.unit, metric.higher_is_better))
    return columns


def wrong_and_certain(outcomes: Sequence[Outcome]) -> dict[str, list[Metric]]:
    """Each plane that is off while its verdict and its σ say that it is not."""
    found = {}
    for outcome in outcomes:
        for key, metrics in outcome.rows.items():
            if key != WHOLE and _value(metrics, "wrong_and_certain") == 1.0:
                plane, instance, _ = key.rsplit("|", 2)
                shown = [metric for metric in metrics if metric.key not in ("off", "wrong_and_certain")]
                found[f"{outcome.label}: {plane} = {instance}"] = shown
    return found


def show(out: Path, outcomes: Sequence[Outcome]) -> None:
    """Print the summary, and how many rows and planes are wrong and certain."""
    print((out / f"{SUMMARY}.md").read_text(encoding="utf-8"))
    certain = wrong_and_certain(outcomes)
    if certain:
        print(markdown_table(certain, "wrong and certain"))
    rows = sum(outcome.value("wrong_and_certain") > 0 for outcome in outcomes)
    failed = sum(bool(outcome.error) for outcome in outcomes)
    print(f"{rows} of {len(outcomes)} rows end wrong and certain ({len(certain)} planes), {failed} failed")
    print(f"Results: {out}")


def file_name(scene: str, variant: str) -> str:
    """Of a row's result: letters, digits and little else."""
    return f"{scene}--" + re.sub(r"[^\w.,+−×½°-]+", "-", variant)


def _value(metrics: Sequence[Metric], key: str) -> float:
    return next((metric.value for metric in metrics if metric.key == key), np.nan)
