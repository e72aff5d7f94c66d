"""What the scripts for the data sets of the paper's Table 1 share: solve and score every scene of a folder."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from pathlib import Path

from common.metrics import Metric, write_tables
from common.runner import Measure, SceneRows, errors_of, find_scenes, run_scenes
from common.scoring import refused, score, summary
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.evaluate import evaluate
from gtlayout.io.scene_folder import ANNOTATION_READERS, load_scene
from gtlayout.method import solve

OURS = "gtlayout"
Scores = dict[str, list[Metric]]
"""Scene → its metrics."""


def annotated_scenes(root: Path) -> dict[str, Path]:
    """The scenes of a folder (or the folder itself) that have annotations; how many have none is said on stderr.

    Releases hold more clips than were annotated; these belong to no test set. Raises GtlayoutError when none is left.
    """
    scenes = find_scenes(root)
    annotated = {
        name: path for name, path in scenes.items() if any(reader.detect(path) for reader in ANNOTATION_READERS)
    }
    if not annotated:
        looked_for = "; ".join(f"{reader.looked_for} ({reader.name})" for reader in ANNOTATION_READERS)
        raise GtlayoutError(f"none of {len(scenes)} scenes in {root} has annotations; looked for {looked_for}")
    if len(annotated) < len(scenes):
        print(f"{len(scenes) - len(annotated)} of {len(scenes)} scenes left out: no annotations", file=sys.stderr)
    return annotated


def measure_ours(folder: Path) -> SceneRows:
    """Solve the scene with default settings and score the layout. Raises GtlayoutError when either is impossible."""
    scene = load_scene(folder)
    start = time.perf_counter()
    solution = solve(scene, Config())
    seconds = time.perf_counter() - start
    return {OURS: score(evaluate(scene, solution.layout), seconds)}


def score_scenes(scenes: Mapping[str, Path], out_dir: Path, label: str, measure: Measure, jobs: int) -> Scores:
    """Scene → what ``measure`` has under ``label``, with a column ``failed``; of earlier runs where nothing changed.

    A scene that can be read but gives no score counts: IoU 0, not accepted. One that cannot be read says nothing about
    the method: it is left out, whatever the method.
    """
    rows = run_scenes(scenes, out_dir / label, measure, f"{label}: {Config()!r}", jobs)
    failed = {name for name in errors_of(scenes, out_dir / label) if _can_be_read(scenes[name])}
    return {
        name: [
            *(refused() if name in failed else rows[name][label]),
            Metric("failed", float(name in failed), "", False),
        ]
        for name in scenes
        if name in rows or name in failed
    }


def summary_row(scores: Scores, scenes: int) -> list[Metric]:
    """Means over the scenes that could be read, with counts of those that failed and of those that could not."""
    counted, *means = summary([[m for m in row if m.key != "failed"] for row in scores.values()])
    failed = sum(metric.value for row in scores.values() for metric in row if metric.key == "failed")
    unreadable = Metric("unreadable", float(scenes - len(scores)), "", False)
    return [counted, Metric("failed", failed, "", False), unreadable, *means]


def write_summary(out_dir: Path, by_scene: Scores, methods: Mapping[str, list[Metric]]) -> None:
    """Write scenes.* and summary.* and print the latter. Raises GtlayoutError when the disk does not take them."""
    write_tables(out_dir, "scenes", by_scene, "scene")
    write_tables(out_dir, "summary", methods, "method")
    print((out_dir / "summary.md").read_text(encoding="utf-8"))
    print(f"Results: {out_dir}")


def _can_be_read(folder: Path) -> bool:
    try:
        load_scene(folder)
    except GtlayoutError:
        return False
    return True
