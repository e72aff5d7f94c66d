"""Solving a scene again after a change of its drawing: how long it takes, and how far a quick solve is from a full one.

Two kinds of changes: a vertex is moved, with all others in its place, and a key frame is added to the others.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
import shapely
from cyclopts import Parameter
from cyclopts.validators import Number

from common.command_line import exit_status, new_app
from common.metrics import Metric, write_tables
from common.runner import SceneRows, run_scenes, scenes_by_folder
from gtlayout.config import Config
from gtlayout.geometry.depth import depth_at_centroid
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import Element, FloatArray, KeyFrame, Scene
from gtlayout.session.session import Session
from gtlayout.solution import Solution

MOVE_PX = 6.0
"""σ of a move along each axis."""
ONE_PLACE_PX = 3.0
"""Vertices this near to each other are one corner, and move together."""
T = TypeVar("T")

app = new_app("session", __doc__)


@app.default
def measure(
    *roots: Annotated[Path, Parameter(name="SCENE")],
    out: Path,
    changes: Annotated[int, Parameter(validator=Number(gte=1))] = 20,
) -> None:
    """Change the drawing of scenes; write tables of seconds and of differences.

    Seconds are of one core's work, by which a busy machine matters less; ``share`` is that of a solve from nothing, by
    which the machine matters less. A run that was cut short goes on where it was.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where tables and the results of each scene go.
    changes
        Vertices that are moved in each scene, and most key frames that are added.
    """
    results: dict[str, SceneRows] = {}
    for folder, scenes in scenes_by_folder(roots).items():
        settings = f"session: {Config()!r} {changes}"
        results |= run_scenes(scenes, out / folder, partial(measure_scene, changes=changes), settings)
    rows = {f"{scene}, {label}": row for scene, of_scene in results.items() for label, row in of_scene.items()}
    write_tables(out, "session", rows, "scene")
    print((out / "session.md").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Difference:
    """A quick solution against a full one of the same drawing."""

    same_instances: bool
    depth_share: FloatArray
    """(P,) of each plane that is known in both: difference of depths at its centroid, as a share."""
    sigma_ratio: FloatArray
    """(P,) σ of depth there, quick to full."""
    iou: float
    """How much larger."""


def measure_scene(folder: Path, changes: int) -> SceneRows:
    """One row for each kind of change. Raises GtlayoutError when the scene cannot be solved."""
    scene = load_scene(folder)
    session = Session(scene)
    _, from_nothing = timed(lambda: session.solve(scene.key_frames))
    rng = np.random.default_rng(0)
    moves = [(scene.key_frames, with_moved_vertex(scene.key_frames, rng)) for _ in range(changes)]
    count = len(scene.key_frames)
    chosen = np.unique(np.linspace(0, count - 1, min(changes, count)).round().astype(int)).tolist()
    added = [(tuple(one for k, one in enumerate(scene.key_frames) if k != n), scene.key_frames) for n in chosen]
    rows = {"moved vertex": compared(scene, session, moves, from_nothing)}
    if count > 1:
        rows["new key frame"] = compared(scene, None, added, from_nothing)
    return rows


def compared(
    scene: Scene,
    session: Session | None,
    changes: Sequence[tuple[Sequence[KeyFrame], Sequence[KeyFrame]]],
    from_nothing: float,
) -> list[Metric]:
    """Figures of ``changes`` of one drawing into another; in sessions of their own when none is given."""
    quick_s, full_s, differences = [], [], []
    for before, after in changes:
        own = session or Session(scene)
        own.solve(before)
        quick, seconds = timed(partial(own.quick, after))
        quick_s.append(seconds)
        full, seconds = timed(partial(own.solve, after))
        full_s.append(seconds)
        differences.append(difference(quick, full))
    depth = np.concatenate([one.depth_share for one in differences])
    ratio = np.concatenate([one.sigma_ratio for one in differences])
    return [
        Metric("quick_median", float(np.median(quick_s)), "s", False),
        Metric("quick_95", float(np.quantile(quick_s, 0.95)), "s", False),
        Metric("full_median", float(np.median(full_s)), "s", False),
        Metric("quick_share", float(np.median(quick_s)) / from_nothing, "", False),
        Metric("full_share", float(np.median(full_s)) / from_nothing, "", False),
        Metric("same_instances", float(np.mean([one.same_instances for one in differences])), "", True),
        Metric("depth_difference_median", float(np.median(depth)), "", False),
        Metric("depth_difference_95", float(np.quantile(depth, 0.95)), "", False),
        Metric("depth_difference_largest", float(depth.max()), "", False),
        Metric("sigma_ratio_least", float(ratio.min()), "", None),
        Metric("sigma_ratio_5", float(np.quantile(ratio, 0.05)), "", None),
        Metric("iou_difference_largest", float(np.max(np.abs([one.iou for one in differences]))), "", False),
    ]


def timed(make: Callable[[], T]) -> tuple[T, float]:
    """What it gives, and the seconds of work that takes."""
    start = time.process_time()
    made = make()
    return made, time.process_time() - start


def with_moved_vertex(key_frames: Sequence[KeyFrame], rng: np.random.Generator) -> tuple[KeyFrame, ...]:
    """The drawings with one corner of one key frame moved, in all outlines that share it; none crosses itself."""
    changed = list(key_frames)
    k = int(rng.integers(len(changed)))
    elements = changed[k].elements
    corners = np.concatenate([shapely.get_coordinates(element.amodal) for element in elements])
    while True:
        corner, step = corners[rng.integers(len(corners))], rng.normal(0.0, MOVE_PX, 2)
        moved = tuple(_with_moved(element, corner, step) for element in elements)
        if all(element.amodal.is_valid for element in moved):
            changed[k] = replace(changed[k], elements=moved)
            return tuple(changed)


def _with_moved(element: Element, corner: FloatArray, step: FloatArray) -> Element:
    def moved(px: FloatArray) -> FloatArray:
        return px + (np.linalg.norm(px - corner, axis=1) < ONE_PLACE_PX)[:, None] * step

    return replace(element, amodal=shapely.transform(element.amodal, moved))


def difference(quick: Solution, full: Solution) -> Difference:
    """Of two solutions of one drawing. Instances are one where they have the same elements."""
    index = {instance.members: i for i, instance in enumerate(full.instances)}
    shares, ratios = [], []
    for i, instance in enumerate(quick.instances):
        j = index.get(instance.members)
        if j is None or not (quick.planes[i].observable and full.planes[j].observable):
            continue
        sigma, depth = depth_at_centroid(quick.scene, instance, quick.planes[i])
        full_sigma, full_depth = depth_at_centroid(full.scene, instance, full.planes[j])
        shares.append(abs(depth / full_depth - 1))
        ratios.append(sigma / full_sigma)
    same = {instance.members for instance in quick.instances} == set(index)
    return Difference(same, np.array(shares), np.array(ratios), quick.quality.iou - full.quality.iou)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
