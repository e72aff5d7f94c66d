"""Where results differ between kinds of processors: scenes solved, and rooms made, as on older ones."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from cyclopts.validators import Number

from common.command_line import GTLAYOUT, exit_status, new_app
from common.metrics import Metric, write_tables
from common.runner import scenes_by_folder
from common.solve_here import DECISIONS_FILE, STAGES_FILE
from gtlayout.errors import GtlayoutError
from gtlayout.results.names import TIMINGS_FILE
from gtlayout.scene import FloatArray
from processors import KINDS, LIBRARIES, imitation

SOLVE_HERE = Path(__file__).parent / "common/solve_here.py"
app = new_app("machines", __doc__)


@dataclass(frozen=True)
class Found:
    """What came of one scene."""

    files: dict[str, bytes]
    """Of the results, but for the timings."""
    stages: dict[str, np.ndarray]
    decisions: dict[str, object]


@app.default
def measure(
    *roots: Annotated[Path, Parameter(name="SCENE")],
    out: Path,
    rooms: Annotated[int, Parameter(validator=Number(gte=0))] = 5,
) -> None:
    """Solve scenes and make synthetic rooms as on older processors, and compare with what this one makes of them.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where the tables go.
    rooms
        So many synthetic rooms are made.
    """
    scenes = {
        f"{folder}/{name}": path for folder, found in scenes_by_folder(roots).items() for name, path in found.items()
    }
    older = imitations()
    scenes_there: dict[str, list[Metric]] = {}
    solved: dict[str, list[Metric]] = {}
    made: dict[str, list[Metric]] = {}
    with tempfile.TemporaryDirectory() as work:
        here = solve_all(scenes, Path(work, "here"), {})
        rooms_here = make_rooms(rooms, Path(work, "rooms"), {})
        for name, variables in older.items():
            there = solve_all(scenes, Path(work, name), variables)
            rows = {}
            for scene, found in there.items():
                rows[f"{scene}: {name}"], other = compare(here[scene], found)
                if other:
                    print(f"{scene}, {name}: other {', '.join(other)}", file=sys.stderr)
            scenes_there |= rows
            solved[name] = worst_of(list(rows.values()))
            made[name] = compare_files(rooms_here, make_rooms(rooms, Path(work, f"{name} rooms"), variables))
    write_tables(out, "scenes", scenes_there, "scene and processor")
    for table, summary in (("solved", solved), ("rooms", made)):
        write_tables(out, table, summary, "processor")
        print((out / f"{table}.md").read_text(encoding="utf-8"))
    print(f"Results: {out}")


def imitations() -> dict[str, dict[str, str]]:
    """Name → environment: each library alone as on an older processor, then all of them.

    Raises GtlayoutError where this processor has nothing to leave out.
    """
    found: dict[str, dict[str, str]] = {}
    for kind in KINDS:
        for name, libraries in [*((library, [library]) for library in LIBRARIES), ("all", LIBRARIES)]:
            variables = imitation(kind, libraries)
            if variables is not None:
                found[f"{name} {kind}"] = variables
    if not found:
        raise GtlayoutError("this processor has nothing that an older one lacks: there is nothing to compare")
    return found


def solve_all(scenes: dict[str, Path], work: Path, variables: dict[str, str]) -> dict[str, Found]:
    """Scene → what comes of it in a process with these environment variables. Raises GtlayoutError when that fails."""
    run_here([sys.executable, str(SOLVE_HERE), str(work), *map(str, scenes.values())], variables)
    return {scene: read_found(work / str(number)) for number, scene in enumerate(scenes)}


def make_rooms(count: int, out: Path, variables: dict[str, str]) -> dict[str, bytes]:
    """The files of so many varied rooms, by path, made in a process with these environment variables."""
    size = ("--width", "240", "--height", "180", "--frames", "8", "--key-every", "4")
    if count:
        run_here([*GTLAYOUT, "synth", str(out), "--count", str(count), *size], variables)
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}


def run_here(command: Sequence[str], variables: dict[str, str]) -> None:
    """Run a command with these environment variables. Raises GtlayoutError with its last line when it fails."""
    done = subprocess.run(command, env=os.environ | variables, capture_output=True, text=True, check=False)
    if done.returncode:
        raise GtlayoutError(f"{' '.join(variables)}: {(done.stderr.strip() or 'no output').splitlines()[-1]}")


def read_found(folder: Path) -> Found:
    """What ``solve_here.py`` wrote."""
    own = (STAGES_FILE, DECISIONS_FILE, TIMINGS_FILE)
    files = {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.name not in own}
    with np.load(folder / STAGES_FILE, allow_pickle=False) as arrays:
        return Found(files, dict(arrays), json.loads((folder / DECISIONS_FILE).read_text(encoding="utf-8")))


def compare(one: Found, other: Found) -> tuple[list[Metric], list[str]]:
    """How far apart two solves of a scene are, and the names of the decisions that differ, the earliest first."""
    decided = [
        name
        for name, array in one.stages.items()
        if array.shape != other.stages[name].shape
        or (np.issubdtype(array.dtype, np.integer) and not np.array_equal(array, other.stages[name]))
    ]
    decided += [name for name, value in one.decisions.items() if value != other.decisions[name]]
    normals = difference(one.stages["planes"][:, :3], other.stages["planes"][:, :3])
    offset, sigma = offsets(one, other)
    row = [
        Metric("other files", sum(one.files[name] != other.files.get(name) for name in one.files), "", False),
        Metric("other decisions", len(decided), "", False),
        Metric("moved observations", _moved(one, other), "", False),
        Metric("points", _largest(difference(one.stages["points_px"], other.stages["points_px"])), "px", False),
        Metric("normals", _largest(normals), "", False),
        Metric("offsets", _largest(offset), "u", False),
        Metric("offsets", _largest(offset / sigma), "σ", False),
        Metric("corners", _largest(difference(one.stages["corners"], other.stages["corners"])), "u", False),
        Metric("iou", _largest(difference(one.stages["ious"], other.stages["ious"])), "", False),
    ]
    return row, decided


def worst_of(rows: Sequence[Sequence[Metric]]) -> list[Metric]:
    """The largest of each number over scenes, and how many scenes have other decisions."""
    others = sum(metric.value > 0 for row in rows for metric in row if metric.key == "other decisions")
    largest = [
        replace(column[0], value=_largest(np.array([m.value for m in column]))) for column in zip(*rows, strict=True)
    ]
    return [Metric("scenes", len(rows), "", None), Metric("decided otherwise", others, "", False), *largest]


def offsets(one: Found, other: Found) -> tuple[FloatArray, FloatArray]:
    """(S,) distance of each plane from the other solve's at the centroid of its extent, and the σ there; scene unit."""
    centroids = one.stages["centroids"]
    points = np.column_stack([centroids, np.ones(len(centroids))])
    planes, others = one.stages["planes"], other.stages["planes"]
    apart = (
        np.abs(np.sum((planes - others) * points, axis=1))
        if planes.shape == others.shape
        else np.full(len(planes), np.nan)
    )
    return apart, one.stages["sigma_offsets"]


def difference(one: FloatArray, other: FloatArray) -> FloatArray:
    """Absolute; NaN everywhere when they are not alike in shape."""
    return np.abs(one - other) if one.shape == other.shape else np.full_like(one, np.nan)


def compare_files(here: dict[str, bytes], there: dict[str, bytes]) -> list[Metric]:
    """How many of the images and of all other files are not the same bytes."""
    other = [name for name in here if here[name] != there.get(name)]
    images = [name for name in here if name.endswith((".jpg", ".png"))]
    return [
        Metric("images", len(images), "", None),
        Metric("other images", len(set(images) & set(other)), "", False),
        Metric("other text files", len(set(other) - set(images)), "", False),
    ]


def _moved(one: Found, other: Found) -> float:
    """How many positions of tracks differ; NaN when the tracks are not the same."""
    points = difference(one.stages["points_px"], other.stages["points_px"])
    return float(np.count_nonzero(points.any(axis=1))) if np.isfinite(points).all() else np.nan


def _largest(values: FloatArray) -> float:
    """NaN when no two can be compared; unobservable planes are NaN in both."""
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else np.nan


def main(arguments: list[str] | None = None) -> int:
    """Run the command line."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
