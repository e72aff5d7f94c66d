"""Curved walls of synthetic rooms: are they found, how far is their radius off, and are planes any worse for them?

Bays and round corners, with other seeds than those on which the settings were chosen. Each room is solved twice from
the same tracks: as it is, and with every wall as a plane.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmark_rooms import LEVELS
from common.command_line import Jobs, exit_status, new_app
from common.metrics import Metric, markdown_table, write_tables
from common.runner import SceneRows, run_scenes
from gtlayout.cli.console import progress_bars
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.instance_scores import match_instances, plane_error
from gtlayout.io.files import read_json
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import FILE, Truth, read_truth
from gtlayout.method import lay_out, prepare, regrouped
from gtlayout.observer import Stages
from gtlayout.solution import Solution
from gtlayout.synth import SynthConfig
from gtlayout.synth.data_set import make_rooms
from gtlayout.synth.room import CURVED_ROOM_KINDS

FIRST_SEED, SEEDS = 2, 2
NEVER = 1e12
"""No wall gains so much."""

app = new_app("curved_walls", __doc__)


@app.default
def measure(*, out: Path, jobs: Jobs = 1) -> None:
    """Make the rooms in ``out``, solve them, and compare with their truth. A run that was cut short goes on.

    Parameters
    ----------
    out
        Where rooms, tables and the results of each room go.
    jobs
        Rooms at a time.
    """
    configs = {out / "rooms" / name: config for name, config in rooms()}
    with progress_bars() as progress:
        progress.stage("rooms")
        make_rooms(configs, jobs, progress.progress)
    measured = run_scenes({path.name: path for path in configs}, out, measure_scene, "curved_walls", jobs)
    table = {group: summary(rows) for group, rows in grouped(measured).items()}
    write_tables(out, "curved_walls", table, "rooms")
    print(markdown_table(table, "rooms"), end="")


def rooms() -> Iterator[tuple[str, SynthConfig]]:
    """``kind-level-seed`` → its parameters."""
    for kind in CURVED_ROOM_KINDS:
        for level, config in LEVELS.items():
            for seed in range(FIRST_SEED, FIRST_SEED + SEEDS):
                yield f"{kind}-{level}-{seed}", replace(config, room=kind, seed=seed)


def measure_scene(folder: Path) -> SceneRows:
    """One row. Raises GtlayoutError when the room has no truth or cannot be solved."""
    scene, config = load_scene(folder), Config()
    truth = read_truth(scene)
    if truth is None:
        raise GtlayoutError(f"{folder} has no {FILE}")
    prepared = prepare(scene, config)
    flat = replace(config, curved=replace(config.curved, min_gain=NEVER))
    solved, planar = (lay_out(*regrouped(prepared, one, Stages()), one) for one in (config, flat))
    planes = read_json(folder / FILE)["planes"]
    name, true = next((name, plane["cylinder"]) for name, plane in planes.items() if "cylinder" in plane)
    drawn = {member for member, plane in truth.elements.items() if plane == name}
    found = [i for i in solved.layout.curved if drawn & set(solved.instances[i].members)]
    row = [
        Metric("found", float(len(found) == 1), "", True),
        Metric("flat walls curved", float(len(solved.layout.curved) - len(found)), "", False),
        Metric("instances", float(sum(bool(drawn & set(one.members)) for one in solved.instances)), "", False),
        Metric("iou", solved.quality.iou, "", True),
        Metric("iou as planes", planar.quality.iou, "", True),
    ]
    if found:
        cylinder = solved.layout.curved[found[0]]
        off = cylinder.radius - true["radius"]
        row += [
            Metric("radius error", 100 * abs(off) / true["radius"], "%", False),
            Metric("radius z", abs(off) / cylinder.sigma_radius, "σ", False),
        ]
    for key, solution in (("", solved), (" as planes", planar)):
        angles, offsets = zip(*errors(solution, truth), strict=True)
        row += [
            Metric(f"normal{key}", float(np.median(angles)), "deg", False),
            Metric(f"offset{key}", 100 * float(np.median(offsets)), "cm", False),
            Metric(f"worst offset{key}", 100 * float(np.max(offsets)), "cm", False),
        ]
    return {"room": row}


def errors(solution: Solution, truth: Truth) -> Iterator[tuple[float, float]]:
    """Of each flat instance that has a plane: the angle of its normal, degrees, and its offset, metres."""
    for name, i in match_instances(solution.layout, truth).items():
        if truth.planes[name].scored and solution.planes[i].observable:
            error = plane_error(solution.layout, i, name, truth.planes[name])
            yield error.normal_deg, error.offset


def grouped(measured: dict[str, SceneRows]) -> dict[str, list[list[Metric]]]:
    """The rows of each kind and level, and of all rooms."""
    groups: dict[str, list[list[Metric]]] = {}
    for name, rows in measured.items():
        for group in (name.rsplit("-", 1)[0], "all"):
            groups.setdefault(group, []).append(rows["room"])
    return {group: groups[group] for group in sorted(groups, key=lambda group: (group == "all", group))}


def summary(rows: list[list[Metric]]) -> list[Metric]:
    """Medians of all, and the largest error of a radius."""
    by_key: dict[str, list[Metric]] = {}
    for metric in (metric for row in rows for metric in row):
        by_key.setdefault(metric.key, []).append(metric)
    table = [Metric("rooms", float(len(rows)), "", None)]
    for key, values in by_key.items():
        of = [one.value for one in values]
        take = np.mean if key in ("found", "flat walls curved", "instances") else np.median
        table.append(replace(values[0], value=float(take(of))))
        if key in ("radius error", "radius z"):
            table.append(replace(values[0], key=f"largest {key}", value=float(np.max(of))))
    return table


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
