"""Proposals: how much of the next drawing is right before a person touches it?"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from common.command_line import Jobs, exit_status, new_app
from common.compared import Compared, compare, drawn_edges
from common.metrics import Metric, mean_over, write_tables
from common.runner import SceneRows, run_scenes, scenes_by_folder
from gtlayout.config import Config
from gtlayout.io.pixels.images import read_bgr
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.order import Order, next_frames
from gtlayout.proposals.propose import Proposer
from gtlayout.scene import FloatArray, Scene
from gtlayout.solution import Solution

GOOD_IOU = 0.9
WITHIN_PX = (3.0, 5.0, 10.0)
BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)
"""Of confidence."""
Solve = Callable[[Scene], Solution]

app = new_app("proposals", __doc__)


@app.default
def measure(
    *roots: Annotated[Path, Parameter(name="SCENE")],
    out: Path,
    jobs: Jobs = 1,
) -> None:
    """Draw the key frames of scenes one after the other, as they were drawn, and compare each with its proposal before.

    In order of the video, and spread. Each is solved anew with every drawing. A run that was cut short goes on where it
    was.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where tables and the results of each scene go.
    jobs
        Scenes at a time.
    """
    results: dict[str, SceneRows] = {}
    for folder, scenes in scenes_by_folder(roots).items():
        results |= run_scenes(
            scenes, out / folder, measure_scene, f"proposals: {Config()!r} {ProposalConfig()!r}", jobs
        )
    write(out, results)
    print((out / "summary.md").read_text(encoding="utf-8"))
    print((out / "confidence.md").read_text(encoding="utf-8"))


def measure_scene(folder: Path) -> SceneRows:
    """What is measured in each order, before and after snapping. Raises GtlayoutError when it cannot be solved."""
    scene = load_scene(folder)
    whole = solve(scene, Config())
    rows: SceneRows = {}
    for order in ("video", "spread"):
        rows |= replay_rows(scene, order, whole, lambda part: solve(part, Config()))
    return rows


def replay_rows(scene: Scene, order: Order, whole: Solution, solve_part: Solve) -> SceneRows:
    """``order, snapped`` or ``order, as predicted`` → figures, and ``confidence|order|bin`` → how many are right.

    ``whole`` is solved from all key frames: it says which elements are one instance.
    """
    rows: SceneRows = {}
    found: dict[str, list[Compared]] = {"as predicted": [], "snapped": []}
    first = 0
    for drawn, upcoming in drawing_order(scene, order):
        if len(drawn) == 1:
            first = len(drawn_edges(scene, drawn[0], None, whole))
        part = replace(scene, key_frames=tuple(scene.key_frames[k] for k in sorted(drawn)))
        proposer = Proposer(solve_part(part), ProposalConfig())
        frame = scene.key_frames[upcoming].frame
        image = read_bgr(scene.frames[frame])
        for name, pixels in (("as predicted", None), ("snapped", image)):
            found[name].append(compare(proposer.propose(frame, pixels), scene, drawn, upcoming, whole))
    for name, all_of_them in found.items():
        rows[f"{order}, {name}"] = figures(all_of_them, first)
    rows |= reliability(order, found["snapped"])
    return rows


def drawing_order(scene: Scene, order: Order) -> Iterator[tuple[list[int], int]]:
    """The key frames that are drawn, and the next one, after each drawing but the last."""
    only = replace(scene, frames=tuple(scene.frame_of(k) for k in range(len(scene.key_frames))), key_frames=())
    chosen = next_frames(only, len(only.frames), order, step=1)
    for count in range(1, len(chosen)):
        yield list(chosen[:count]), chosen[count]


def figures(compared: Sequence[Compared], first_edges: int) -> list[Metric]:
    """The figures of one order: of edges all together, of IoUs also after two drawings."""
    edges = [edge for one in compared for edge in one.edges]
    whole, line = (np.array([getattr(edge, key) for edge in edges]) for key in ("whole_px", "line_px"))
    visible = np.array([edge.visible for edge in edges])
    iou = np.concatenate([one.iou for one in compared])
    after_two = [one.iou for one in compared if one.drawings == 2]
    both, proposed, drawn = np.sum([one.visible_px2 for one in compared], axis=0).tolist()
    return [
        Metric("iou_after_two", _mean(np.concatenate(after_two)) if after_two else np.nan, "", True),
        Metric("iou", _mean(iou), "", True),
        Metric("iou_90", _mean(iou >= GOOD_IOU), "", True),
        *(Metric(f"edges_{px:.0f}px", _mean(whole <= px), "", True) for px in WITHIN_PX),
        Metric("session_5px", float(np.sum(whole <= 5.0)) / (len(edges) + first_edges), "", True),
        *(Metric(f"lines_{px:.0f}px", _mean(line <= px), "", True) for px in WITHIN_PX),
        Metric("visible_lines_3px", _mean(line[visible] <= 3.0), "", True),
        Metric("visible_edges_3px", _mean(whole[visible] <= 3.0), "", True),
        Metric("visible_line", float(np.median(line[visible])) if visible.any() else np.nan, "px", False),
        Metric("false_elements", float(sum(one.false_elements for one in compared)), "", False),
        Metric("visible_iou", both / (proposed + drawn - both) if proposed + drawn else np.nan, "", True),
        Metric("visible_outside", 1 - both / proposed if proposed else np.nan, "", False),
        Metric("edges", float(len(edges)), "", None),
    ]


def reliability(order: str, compared: Sequence[Compared]) -> SceneRows:
    """``confidence|order|bin`` → edges of such a confidence, the sum of their confidences, and how many are left."""
    confidence = np.concatenate([one.confidence for one in compared])
    left = np.concatenate([one.left for one in compared])
    rows: SceneRows = {}
    for low, high in pairwise(BINS):
        here = (confidence >= low) & ((confidence < high) | (high == BINS[-1]))
        rows[f"confidence|{order}|{low:.1f}–{high:.1f}"] = [
            Metric("edges", float(here.sum()), "", None),
            Metric("said", float(confidence[here].sum()), "", None),
            Metric("left", float(left[here].sum()), "", None),
        ]
    return rows


def write(out: Path, results: Mapping[str, SceneRows]) -> None:
    """The tables: each scene and the mean of all in each order, and the reliability of all scenes together."""
    table: dict[str, Sequence[Metric]] = {}
    sums: dict[str, list[list[Metric]]] = {}
    for label in dict.fromkeys(label for rows in results.values() for label in rows):
        here = {name: rows[label] for name, rows in results.items() if label in rows}
        if label.startswith("confidence|"):
            sums.setdefault(label.split("|")[2], []).extend(here.values())
        else:
            table |= {f"{name}: {label}": row for name, row in here.items()}
            table[f"mean: {label}"] = mean_over(list(here.values()))
    write_tables(out, "summary", table, "scene")
    write_tables(out, "confidence", {label: _pooled(rows) for label, rows in sums.items()}, "confidence")


def _pooled(rows: Sequence[Sequence[Metric]]) -> list[Metric]:
    count, said, left = (
        sum(metric.value for row in rows for metric in row if metric.key == key) for key in ("edges", "said", "left")
    )
    share = 1 / count if count else np.nan
    return [
        Metric("edges", count, "", None),
        Metric("mean_confidence", said * share, "", None),
        Metric("left_share", left * share, "", None),
    ]


def _mean(values: FloatArray | np.typing.NDArray[np.bool_]) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
