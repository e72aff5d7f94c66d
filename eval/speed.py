"""Speed: what a solve takes and where, how that grows, and how it compares with the paper's own optimiser."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from cyclopts.validators import Number

from ablation import RUNS, Series, own_planes, paper_planes, paper_problem, run_series
from common import adam
from common.command_line import GTLAYOUT, exit_status, new_app
from common.metrics import Metric, write_tables
from common.runner import scenes_by_folder
from common.stage_times import stage_rows
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve
from gtlayout.planes.contacts import start_without_wrong_contacts
from gtlayout.planes.estimation import optimise
from gtlayout.planes.evidence import gather
from gtlayout.planes.uncertainty import error_scales, plane_uncertainty
from gtlayout.prepared.measurements import Measurements, Prepared
from gtlayout.solution import Solution
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.triangulation import triangulate
from simulated import simulation
from simulated.simulated_room import Room, look_at, make_room, prism_faces, ring

CHILD_USAGE = Path(__file__).parent / "common/child_usage.py"
MIB = 1 << 20


@dataclass(frozen=True)
class Size:
    """Of a simulated room: a prism, seen on a full turn."""

    tracks: int = 375
    walls: int = 4
    frames: int = 120
    reach: int = 40
    """Frames that a point is followed each way."""
    key_frames: int = 10


BASE = Size()
GROWTH = {
    "1 ×": BASE,
    "tracks 4 ×": replace(BASE, tracks=4 * BASE.tracks),
    "tracks 16 ×": replace(BASE, tracks=16 * BASE.tracks),
    "planes 2 ×": replace(BASE, walls=10),
    "planes 4 ×": replace(BASE, walls=22),
    "frames 2 ×": replace(BASE, frames=2 * BASE.frames),
    "frames 4 ×": replace(BASE, frames=4 * BASE.frames),
    "1,500 tracks, 20,000 observations, 6 planes": replace(BASE, tracks=1500, reach=9),
}
"""The last one has a limit: its graph, 0.6 s on two cores."""
KEY_FRAMES = (15, 30, 60)
"""Of the rooms that ``marginals`` are timed on. The last one has a limit: its marginals, 1 s on one core."""
WIDE = np.array([[170.0, 0, 320], [0, 170, 240], [0, 0, 1]])

app = new_app("speed", __doc__)


@app.default
def measure(
    *roots: Annotated[Path, Parameter(name="SCENE")],
    out: Path,
    runs: Annotated[int, Parameter(validator=Number(gte=1, lte=max(RUNS)))] = 10,
    repeats: Annotated[int, Parameter(validator=Number(gte=1))] = 3,
) -> None:
    """Time solves of scenes, stage by stage and beside the least that following points costs; the paper's optimiser on
    the same tracks; and the estimator on simulated rooms.

    Only what is run is printed, and all of it is run now: nothing is taken from an earlier run, nothing extrapolated.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where the tables go.
    runs
        Runs of the paper's optimiser, which takes 100 in the paper.
    repeats
        Times that all else is run; the shortest counts.
    """
    scenes: dict[str, list[Metric]] = {}
    papers: dict[str, list[Metric]] = {}
    stages: dict[str, list[Metric]] = {}
    for folder, found in scenes_by_folder(roots).items():
        for name, path in found.items():
            try:
                command = time_command(path, repeats)
                solution, solved = time_solve(path, repeats)
                stages |= stage_rows(path, f"{folder}/{name}", repeats)
            except GtlayoutError as error:
                print(f"{folder}/{name}: {error}", file=sys.stderr)
                continue
            prepared = prepared_of(solution)
            scenes[f"{folder}/{name}"] = [*command, *solved, *time_estimation(prepared, repeats)]
            papers[f"{folder}/{name}"] = compare_with_paper(prepared, runs, repeats)
    growth = grown({name: time_estimation(simulated(size), repeats) for name, size in GROWTH.items()})
    marginals = grown({f"{count} key frames": time_marginals(count, repeats) for count in KEY_FRAMES})
    tables = [("scenes", scenes, "scene"), ("stages", stages, "scene"), ("paper", papers, "scene")]
    for name, rows, title in (*tables, ("growth", growth, "simulated"), ("marginals", marginals, "simulated")):
        write_tables(out, name, rows, title)
        print((out / f"{name}.md").read_text(encoding="utf-8"))
    print(f"Results: {out}")


def time_command(folder: Path, repeats: int) -> list[Metric]:
    """``gtlayout solve`` as it is called: shortest time and largest peak memory. Raises GtlayoutError when it fails."""
    seconds, peak = [], []
    for _ in range(repeats):
        took_s, peak_bytes = run_solve(folder)
        seconds.append(took_s)
        peak.append(peak_bytes)
    return [Metric("command", min(seconds), "s", False), Metric("peak_memory", max(peak) / MIB, "MiB", False)]


def run_solve(folder: Path) -> tuple[float, int]:
    """Seconds and peak memory, in bytes, of one ``gtlayout solve``. Raises GtlayoutError when it fails."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, str(CHILD_USAGE), *GTLAYOUT, "solve", str(folder), "--out", out]
        ran = subprocess.run(command, capture_output=True, text=True, check=True)
    usage = json.loads(ran.stdout.splitlines()[-1])
    if usage["status"] != 0:
        raise GtlayoutError(ran.stderr.strip() or f"gtlayout solve ended with exit status {usage['status']}")
    return usage["seconds"], usage["peak_bytes"]


def time_solve(folder: Path, repeats: int) -> tuple[Solution, list[Metric]]:
    """The same within this process, files read already. Raises GtlayoutError when the scene cannot be solved."""
    scene = load_scene(folder)
    seconds, stages = [], []
    for _ in range(repeats):
        start = time.perf_counter()
        solution = solve(scene, Config())
        seconds.append(time.perf_counter() - start)
        stages.append(solution.timings_s)
    shortest = {name: min(of[name] for of in stages) for name in ("tracking", "estimation")}
    return solution, [
        Metric("solve", min(seconds), "s", False),
        *(Metric(name, of, "s", False) for name, of in shortest.items()),
        Metric("estimation_share", shortest["estimation"] / min(seconds), "", None),
    ]


def time_estimation(prepared: Prepared, repeats: int) -> list[Metric]:
    """Size of the problem, and shortest times of the two halves of stage 4: the starting planes, and the graph.

    The graph is all of it: scales of the noise, built, optimised, marginals.
    """
    scene, config = prepared.scene, Config()
    local = Normalisation.of(prepared.rays)
    cameras = [local.camera(frame.camera) for frame in scene.frames]
    starts, graphs = [], []
    for _ in range(repeats):
        begin = time.perf_counter()
        evidence = gather(prepared, local, config.estimation)
        evidence, planes = start_without_wrong_contacts(evidence, config.estimation, config.seed)
        between = time.perf_counter()
        optimise(cameras, prepared.tracks, evidence, planes, config.estimation)
        graphs.append(time.perf_counter() - between)
        starts.append(between - begin)
    return [
        Metric("tracks", len(prepared.tracks), "", None),
        Metric("observations", len(prepared.tracks.track), "", None),
        Metric("planes", len(prepared.instances), "", None),
        Metric("frames", len(scene.frames), "", None),
        Metric("start", min(starts), "s", False),
        Metric("graph", min(graphs), "s", False),
    ]


def time_marginals(key_frames: int, repeats: int) -> list[Metric]:
    """Shortest times of the scales of the errors and of the planes' covariance, both at the true planes.

    The room has 24 instances, each with an element in every key frame and 20 tracks on it.
    """
    config, room = replace(Config().estimation, max_tracks=20 * key_frames), seen_from_above(key_frames)
    tracks = simulation.make_tracks(room, np.random.default_rng(0), per_element=20, reach=10)
    measured = simulation.measurements(room, tracks)
    local = Normalisation.of(measured.rays)
    evidence = gather(measured, local, config)
    planes = room.planes.copy()
    planes[:, 3] = local.scale * (planes[:, 3] + planes[:, :3] @ local.origin)
    scales, marginals = [], []
    for _ in range(repeats):
        begin = time.perf_counter()
        error_scales(tracks, evidence, planes, config)
        between = time.perf_counter()
        plane_uncertainty(tracks, evidence, planes, config)
        marginals.append(time.perf_counter() - between)
        scales.append(between - begin)
    return [
        Metric("tracks", len(tracks), "", None),
        Metric("planes", len(planes), "", None),
        Metric("elements", sum(len(instance.members) for instance in room.instances), "", None),
        Metric("edges", len(evidence.edges), "", None),
        Metric("scales", min(scales), "s", False),
        Metric("marginals", min(marginals), "s", False),
    ]


def seen_from_above(key_frames: int) -> Room:
    """A prism of 22 walls, floor and ceiling, seen by a wide lens that goes round above its middle."""
    frames = 2 * key_frames
    angle = 2 * np.pi * np.arange(frames) / frames
    centers = np.column_stack([0.5 * np.cos(angle), 0.5 * np.sin(angle), np.full(frames, 5.5)])
    cameras = [look_at(center, np.zeros(3), WIDE) for center in centers]
    return make_room(cameras, list(range(0, frames, 2)), prism_faces(22), min_area_px=30.0)


def compare_with_paper(prepared: Prepared, runs: int, repeats: int) -> list[Metric]:
    """Seconds from tracks and edges to the IoU: one run of ours, as many of the paper's as were run, and the ratio.

    The paper's are timed once each: their number evens them out.
    """
    config = Config()
    ours = run_series(lambda _number: own_planes(prepared, config, 0), prepared, config, repeats).seconds.min()
    problem = paper_problem(prepared)
    series = run_series(partial(paper_planes, problem, adam.AdamConfig()), prepared, config, runs)
    return [Metric("gtlayout", float(ours), "s", False), *_papers(series, float(ours), runs)]


def _papers(series: Series, ours_s: float, runs: int) -> list[Metric]:
    metrics = []
    for count in sorted({*(r for r in RUNS if r < runs), runs}):
        seconds = float(series.seconds[:count].sum())
        metrics += [
            Metric(f"paper, R = {count}", seconds, "s", False),
            Metric(f"ratio, R = {count}", seconds / ours_s, "", None),
        ]
    return metrics


def simulated(size: Size) -> Prepared:
    """A room without images, tracks half a pixel off."""
    key_frames = np.linspace(0, size.frames, size.key_frames, endpoint=False).astype(int).tolist()
    room = make_room(ring(size.frames), key_frames, prism_faces(size.walls))
    elements = sum(len(key_frame.elements) for key_frame in room.scene.key_frames)
    # Points near the border of the image are soon lost: some more than are wanted, then as many as are.
    tracks = simulation.make_tracks(
        room, np.random.default_rng(0), per_element=int(np.ceil(1.5 * size.tracks / elements)), reach=size.reach
    )
    tracks = simulation.chosen(tracks, np.linspace(0, len(tracks) - 1, size.tracks).round().astype(int))
    return simulation.as_given(simulation.measurements(room, tracks))


def prepared_of(solution: Solution) -> Prepared:
    """What a solve handed to its estimator."""
    return simulation.as_given(
        Measurements(
            solution.scene,
            solution.tracks,
            triangulate(solution.scene, solution.tracks, Config().triangulation),
            solution.layout.instances,
            solution.track_instance,
            solution.edges,
        )
    )


def grown(rows: Mapping[str, Sequence[Metric]]) -> dict[str, list[Metric]]:
    """The rows with each time as a multiple of the first row's beside it."""
    first = {metric.key: metric.value for metric in next(iter(rows.values()))}
    return {
        name: [
            *row,
            *(Metric(f"{m.key}_ratio", m.value / first[m.key], "", None) for m in row if m.unit == "s"),
        ]
        for name, row in rows.items()
    }


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
