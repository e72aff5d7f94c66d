"""A simulated annotator draws real clips from nothing, with proposals to correct: how much is left to do?

The first key frame is drawn by hand. Each further one is proposed from a quick solve of those before; what is further
than 5 (or 3) px from what a person drew is corrected. A full solve follows before the next, as behind a person's back.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from common.command_line import Jobs, exit_status, new_app
from common.metrics import Metric, write_tables
from common.runner import SceneRows, run_scenes, scenes_by_folder
from gtlayout.config import Config
from gtlayout.evaluation.evaluate import WORST_SHARE
from gtlayout.geometry.raster import fill, rings_of
from gtlayout.io.pixels.images import read_bgr, read_depth
from gtlayout.io.scene_folder import load_scene
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.propose import propose
from gtlayout.quality.assess import assess
from gtlayout.scene import Scene
from gtlayout.session.session import Session
from gtlayout.solution import Solution
from simulated.simulated_annotator import Effort, corrected, drawn_by_hand

REACHES_PX = (5.0, 3.0)
ENOUGH = 1.1
"""A layout is as good as the last one when its error is at most this many times as large …"""
COVERED = 0.95
"""… and it shows at least this share of the pixels."""

app = new_app("annotator", __doc__)


@app.default
def measure(*roots: Annotated[Path, Parameter(name="SCENE")], out: Path, jobs: Jobs = 1) -> None:
    """Draw the key frames of scenes in order of the video, by correcting proposals.

    Of edges, those on the border of the image do not count. A run that was cut short goes on where it was.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where tables and the results of each scene go.
    jobs
        Scenes at a time. Seconds of waiting are only right with one.
    """
    results: dict[str, SceneRows] = {}
    for folder, scenes in scenes_by_folder(roots).items():
        results |= run_scenes(
            scenes, out / folder, measure_scene, f"annotator: {Config()!r} {ProposalConfig()!r}", jobs
        )
    rows = {f"{scene}, {label}": row for scene, of_scene in results.items() for label, row in of_scene.items()}
    write_tables(out, "annotator", rows, "scene")
    print((out / "annotator.md").read_text(encoding="utf-8"))


def measure_scene(folder: Path) -> SceneRows:
    """One row for each reach, and one for all drawn by hand. Raises GtlayoutError when the scene cannot be solved."""
    scene = load_scene(folder)
    session = Session(scene)
    by_hand = session.solve(scene.key_frames)
    rows: SceneRows = {}
    for reach_px in REACHES_PX:
        rows[f"proposals, {reach_px:g} px"] = figures(scene, replay(scene, Session(scene), reach_px))
    efforts = [drawn_by_hand(k, scene.frames[k.frame].camera) for k in scene.key_frames]
    hand = Replay(sum(efforts, Effort()), 0, (by_hand,), ())
    rows["by hand"] = [
        metric for metric in figures(scene, hand) if metric.key not in ("key_frames_needed", "wait", "longest_wait")
    ]
    return rows


@dataclass(frozen=True)
class Replay:
    """What drawing a scene took and gave."""

    effort: Effort
    from_nothing: int
    """Edges of the first key frame, for which nothing was proposed."""
    solutions: tuple[Solution, ...]
    """In full, after each key frame."""
    waits_s: tuple[float, ...]
    """From each confirmed drawing until the next proposal."""


def replay(scene: Scene, session: Session, reach_px: float) -> Replay:
    """Draw all key frames of a scene one after the other."""
    first, *others = scene.key_frames
    camera = scene.frames[first.frame].camera
    effort = drawn_by_hand(first, camera)
    from_nothing, drawn, waits = effort.edges, [first], []
    start = time.perf_counter()
    solution = session.solve(drawn)
    waits.append(time.perf_counter() - start)
    solutions = [solution]
    for wanted in others:
        start = time.perf_counter()
        if len(drawn) > 1:
            solution = session.quick(drawn)
        image = read_bgr(scene.frames[wanted.frame])
        proposal = propose(solution, wanted.frame, image=image)
        waits.append(time.perf_counter() - start)
        key_frame, more = corrected(proposal.key_frame(), wanted, scene.frames[wanted.frame].camera, reach_px)
        if len(drawn) > 1:
            solutions.append(session.solve(drawn))
        effort += more
        drawn.append(key_frame)
    solutions.append(session.solve(drawn))
    return Replay(effort, from_nothing, tuple(solutions), tuple(waits))


def figures(scene: Scene, replayed: Replay) -> list[Metric]:
    """What is reported of a drawing, judged by what a person drew in all key frames."""
    effort, last = replayed.effort, replayed.solutions[-1]
    errors = [depth_error(scene, solution) for solution in replayed.solutions]
    final, shown = errors[-1]
    good = [bool(error <= ENOUGH * final and share >= COVERED * shown) for error, share in errors]
    # From there on all are good.
    needed = len(good) - next((n for n, one in enumerate(reversed(good)) if not one), len(good)) + 1
    judged = assess(scene_of(scene, last), last.instances, last.planes, last.layout.extents, last.config.quality)
    unit = "m" if scene.metric else ""
    return [
        Metric("edges", effort.edges, "", None),
        Metric("untouched", effort.untouched / effort.edges, "", True),
        Metric("untouched_of_proposed", effort.untouched / max(effort.edges - replayed.from_nothing, 1), "", True),
        Metric("moved", effort.moved, "", False),
        Metric("placed", effort.placed, "", False),
        Metric("removed", effort.removed, "", False),
        Metric("clicks", effort.clicks, "", False),
        Metric("key_frames_needed", needed if np.isfinite(final) else np.nan, "", False),
        Metric("wait", float(np.median(replayed.waits_s)) if replayed.waits_s else np.nan, "s", False),
        Metric("longest_wait", float(np.max(replayed.waits_s)) if replayed.waits_s else np.nan, "s", False),
        Metric("depth_error_trimmed", final, unit, False),
        Metric("iou", judged.iou, "", True),
    ]


def scene_of(scene: Scene, solution: Solution) -> Scene:
    """The scene as it was drawn by the person, with the cameras of a solution."""
    return replace(scene, frames=solution.scene.frames)


def depth_error(scene: Scene, solution: Solution) -> tuple[float, float]:
    """Mean error of depth without the worst, world unit, and the share of pixels at which the layout shows anything:
    on the visible parts of all key frames, drawn yet or not. NaN without measured depth.
    """
    errors, missing = [np.empty(0)], 0
    for key_frame in scene.key_frames:
        frame = solution.scene.frames[key_frame.frame]
        if frame.depth_path is None:
            continue
        measured = read_depth(frame)
        _, rendered = solution.render(frame.camera)
        for element in key_frame.elements:
            seen = np.isfinite(measured) & fill(rings_of(element.visible), *measured.shape)
            missing += int(np.count_nonzero(seen & ~np.isfinite(rendered)))
            seen &= np.isfinite(rendered)
            errors.append(np.abs(rendered[seen] - measured[seen]))
    pooled = np.sort(np.concatenate(errors))
    if len(pooled) == 0:
        return np.nan, np.nan
    kept = max(1, int(np.ceil((1 - WORST_SHARE) * len(pooled))))
    return float(pooled[:kept].mean()), len(pooled) / (len(pooled) + missing)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
