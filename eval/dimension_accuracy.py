"""Dimensions people sign: are those called LOA20 within it, and what do a few measurements by hand change?"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import shapely
from cyclopts import Parameter
from shapely import LineString

from common.command_line import Jobs, exit_status, new_app
from common.metrics import Metric, write_tables
from common.runner import SceneRows, run_scenes, scenes_by_folder
from gtlayout.accuracy import UPPER_ENDS_M
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.instance_scores import centroid_world, match_instances
from gtlayout.geometry.polygons import polygons
from gtlayout.geometry.rays import depth_on_plane
from gtlayout.instances import Dimension, PlaneFrame
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import TruePlane, Truth, read_truth
from gtlayout.layout import Layout
from gtlayout.measurement import MEASURED_AS, TAPE_SIGMA_M, MeasuredKind, Measurement
from gtlayout.method import solve, with_measurements
from gtlayout.scene import BoolArray, FloatArray
from gtlayout.solution import Solution

LOA = 20
MEASURED = 3
"""So many dimensions are measured by hand, each the one that gtlayout proposes."""
FALSE_M = 0.05
"""How far off one of them is made."""
OF_MEASURING = ("measured", "false", "at its limit", "twice")
"""Rows that are not of a dimension."""
app = new_app("dimension_accuracy", __doc__)


@app.default
def run(*roots: Annotated[Path, Parameter(name="SCENE")], out: Path, jobs: Jobs = 1) -> None:
    """Solve scenes with default settings, and compare every dimension with the same one between true planes.

    Scenes need gt_planes.json in metres. A run that was cut short goes on where it was.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where the table and the results of each scene go.
    jobs
        Scenes at a time.
    """
    rows: dict[str, list[Metric]] = {}
    every: list[SceneRows] = []
    for folder, scenes in scenes_by_folder(roots).items():
        found = run_scenes(scenes, out / folder, measure, f"dimensions: {Config()!r}", jobs)
        every += found.values()
        rows[folder] = summary(list(found.values()))
    rows["all"] = summary(every)
    write_tables(out, "dimensions", rows, "scenes")
    print((out / "dimensions.md").read_text(encoding="utf-8"))


def measure(folder: Path) -> SceneRows:
    """``kind first second`` → error and prediction of each dimension; ``measured`` and ``false`` → what came of these.

    Raises GtlayoutError when the scene cannot be read or solved, or has no truth in metres.
    """
    scene = load_scene(folder)
    truth = read_truth(scene)
    if truth is None or not scene.metric:
        raise GtlayoutError(f"{folder}: no gt_planes.json in metres, so nothing to compare dimensions with")
    return compare(solve(scene, Config(loa=LOA)), truth, zlib.crc32(folder.name.encode()))


def compare(solution: Solution, truth: Truth, seed: int) -> SceneRows:
    """The same for a scene that is solved already; ``seed`` is of the errors of the tape."""
    named = match_instances(solution.layout, truth)
    true = {index: truth.planes[name] for name, index in named.items() if truth.planes[name].scored}
    rows: SceneRows = {}
    for one in solution.layout.dimensions:
        length = true_length(one, true)
        if np.isfinite(length):
            rows[_name(solution.layout, one)] = _of_dimension(one, length)
    rng = np.random.default_rng(seed)
    measurements = _measured_by_hand(solution, true, rng)
    if measurements:
        better = _with(solution, measurements)
        rows["measured"] = [
            _plain("within before", _share_within(solution.layout)),
            _plain("within after", _share_within(better.layout)),
            _plain("named", float(np.mean([not one.used for one in better.layout.measurements]))),
        ]
        which = int(rng.integers(len(measurements)))
        rows["false"] = _falsified(solution, measurements, which, FALSE_M)
        hidden = better.layout.measurements[which].hidden_slip
        rows["at its limit"] = _falsified(solution, measurements, which, hidden if np.isfinite(hidden) else FALSE_M)
        again = [replace(one, value=one.value + rng.normal(0, np.sqrt(2) * TAPE_SIGMA_M)) for one in measurements]
        rows["twice"] = _falsified(solution, [*measurements, *again], which, FALSE_M)
    return rows


def true_length(one: Dimension, true: dict[int, TruePlane]) -> float:
    """The length of a dimension between the true planes, in the same place; NaN where the truth does not tell it.

    Between planes along the line that it was measured on; of a door or window, across its true outline there.
    """
    if one.first not in true or one.second not in true:
        return np.nan
    across = (one.ends_world[1] - one.ends_world[0]) / one.length
    if one.kind in ("height", "width"):
        first, second = (_along(true[i], one.ends_world[0], across) for i in (one.first, one.second))
        return second - first
    ends = _true_ends(true[one.second], one.ends_world, across)
    if one.kind == "sill":
        ends = _true_ends(true[one.second], np.stack([one.ends_world[1], one.ends_world[1] + across]), across)
        floor = true[one.first]
        return np.nan if ends is None else float(floor.normal @ ends[0] + floor.d)
    return np.nan if ends is None else float(np.linalg.norm(ends[1] - ends[0]))


def _along(plane: TruePlane, start: FloatArray, across: FloatArray) -> float:
    return float(depth_on_plane(plane.normal @ start + plane.d, np.array(plane.normal @ across)))


def _true_ends(plane: TruePlane, ends_world: FloatArray, across: FloatArray) -> FloatArray | None:
    """(2, 3) where the line through two points, dropped on a true plane, enters and leaves its true extent."""
    if plane.extent_world is None:
        return None
    frame = PlaneFrame.across(plane.normal, -plane.d * plane.normal)
    region = polygons(frame.region(plane.extent_world))
    middle, along = frame.to_plane(ends_world.mean(axis=0)[None])[0], frame.axes @ across
    reach = 10 * float(np.linalg.norm(ends_world[1] - ends_world[0])) + 10
    chord = region.intersection(LineString([middle - reach * along, middle + reach * along]))
    if chord.is_empty:
        return None
    points = shapely.get_coordinates(chord)
    order = np.argsort(points @ along)
    return frame.to_world(points[order[[0, -1]]])


def _of_dimension(one: Dimension, length: float) -> list[Metric]:
    error = abs(one.length - length)
    assert one.accuracy is not None
    return [
        Metric("error", error, "m", False),
        _plain("deviations", error / one.sigma),
        _plain("called", float(one.accuracy.status == "within")),
        _plain("true", float(error <= UPPER_ENDS_M[LOA])),
    ]


def _measured_by_hand(solution: Solution, true: dict[int, TruePlane], rng: np.random.Generator) -> list[Measurement]:
    """The dimensions that gtlayout proposes one after the other, as a tape measures them.

    Where the truth does not know the proposal, the most uncertain of those it knows; where nothing is left to propose,
    the most certain, which checks the others best.
    """
    measurements: list[Measurement] = []
    now = solution
    for _ in range(MEASURED):
        done = {(one.kind, one.instances) for one in measurements}
        layout = now.layout
        known = [
            one
            for one in layout.dimensions
            if np.isfinite(true_length(one, true)) and _measurement_of(layout, one, 1.0)[:2] not in done
        ]
        if not known:
            break
        following = layout.next_measurement
        proposed = None if following is None else layout.dimensions[following.dimension]
        instead = min(known, key=lambda one: one.sigma) if proposed is None else max(known, key=lambda one: one.sigma)
        chosen = next((one for one in known if one is proposed), instead)
        kind, names, _ = _measurement_of(layout, chosen, 1.0)
        value = true_length(chosen, true) + rng.normal(0, TAPE_SIGMA_M)
        measurements.append(Measurement(kind, names, value, TAPE_SIGMA_M))
        now = _with(solution, measurements)
    return measurements


def _measurement_of(layout: Layout, one: Dimension, value: float) -> tuple[MeasuredKind, tuple[str, ...], float]:
    kind = MEASURED_AS[one.kind]
    names = [layout.instances[i].name for i in (one.first, one.second)]
    return kind, tuple(names) if kind == "between" else (names[1],), value


def _falsified(solution: Solution, measurements: Sequence[Measurement], which: int, slip_m: float) -> list[Metric]:
    """One measurement off by ``slip_m``: is it named, is another, and how far does it drag planes, in their σ?"""
    wrong = list(measurements)
    wrong[which] = replace(wrong[which], value=wrong[which].value + slip_m)
    others = [one for number, one in enumerate(measurements) if number != which]
    dragged, without = _with(solution, wrong), _with(solution, others)
    used = [one.used for one in dragged.layout.measurements]
    drag = 0.0
    for i, plane in enumerate(without.layout.planes):
        if plane.observable and not without.layout.extents[i].region.is_empty:
            centroid = centroid_world(without.layout.extents[i])
            other = dragged.layout.planes[i]
            moved = abs(float((other.normal - plane.normal) @ centroid) + other.d - plane.d)
            drag = max(drag, moved / float(plane.sigma_offset(centroid)))
    checked = dragged.layout.measurements[which]
    return [
        _plain("is named", float(not used[which])),
        _plain("another named", float(not all(used[:which] + used[which + 1 :]))),
        _plain("held back", float(checked.held_back)),
        _plain("slip", slip_m),
        _plain("hidden slip", checked.hidden_slip),
        _plain("drag", drag),
    ]


def _with(solution: Solution, measurements: Sequence[Measurement]) -> Solution:
    return with_measurements(replace(solution, scene=replace(solution.scene, measurements=tuple(measurements))))


def _share_within(layout: Layout) -> float:
    return float(np.mean([one.accuracy is not None and one.accuracy.status == "within" for one in layout.dimensions]))


def summary(scenes: Sequence[SceneRows]) -> list[Metric]:
    """One row of the table."""

    def values(label: str, key: str) -> FloatArray:
        return np.array([m.value for rows in scenes for m in rows.get(label, []) if m.key == key])

    dimensions = [row for rows in scenes for label, row in rows.items() if label not in OF_MEASURING]
    error, deviations, called, true = (
        np.array([m.value for row in dimensions for m in row if m.key == key])
        for key in ("error", "deviations", "called", "true")
    )
    drag, named, hidden = (values("false", key) for key in ("drag", "is named", "hidden slip"))
    return [
        _plain("dimensions", len(error)),
        Metric("median error", _median(error), "m", False),
        _plain("within 2 σ", _mean(deviations <= 2)),
        _plain(f"called LOA{LOA}", _mean(called)),
        Metric("… and it is", _mean(true[called > 0]), "", True),
        Metric(f"of those that are LOA{LOA} called so", _mean(called[true > 0]), "", True),
        _plain("share called before measuring", _mean(values("measured", "within before"))),
        Metric(f"… after {MEASURED}", _mean(values("measured", "within after")), "", True),
        Metric("right measurements named", _mean(values("measured", "named")), "", False),
        Metric(f"{100 * FALSE_M:g} cm off: named", _mean(named), "", True),
        Metric("… another one named", _mean(values("false", "another named")), "", False),
        _plain("… held back", _mean(values("false", "held back"))),
        _plain("… could hide, median, m", _median(hidden)),
        Metric("… of those that could not hide it: named", _mean(named[hidden <= FALSE_M]), "", True),
        _plain("… so many", float(np.count_nonzero(hidden <= FALSE_M))),
        Metric("… largest drag of a plane, median, σ", _median(drag), "", False),
        Metric("… largest of all, σ", float(np.max(drag, initial=0.0)), "", False),
        Metric("… drag above 1 σ", _mean(drag > 1), "", False),
        Metric("off by what it could hide: named", _mean(values("at its limit", "is named")), "", True),
        Metric(f"{100 * FALSE_M:g} cm off, each measured twice: named", _mean(values("twice", "is named")), "", True),
        Metric("… its second or another one named", _mean(values("twice", "another named")), "", False),
        Metric("… with drag above 1 σ", _mean(values("twice", "drag") > 1), "", False),
    ]


def _name(layout: Layout, one: Dimension) -> str:
    return f"{one.kind} {layout.instances[one.first].name} {layout.instances[one.second].name}"


def _plain(key: str, value: float) -> Metric:
    return Metric(key, float(value), "", None)


def _mean(values: FloatArray | BoolArray) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) else np.nan


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
