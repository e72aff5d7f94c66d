"""Closing what was not seen: how much of what is added is right, and how much of what nobody saw is recovered.

The truth is the whole outline of each surface, in ``gt_planes.json`` of synthetic rooms. *Unseen* is what the solved
extent leaves of it; surfaces that no key frame draws have no instance, and are not counted.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from common.command_line import Jobs, exit_status, new_app
from common.metrics import Metric, markdown_table, write_tables
from common.runner import SceneRows, run_scenes, scenes_by_folder
from gtlayout.closing.close import close
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.instance_scores import match_instances
from gtlayout.geometry.polygons import polygons
from gtlayout.io.files import read_json
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import FILE, read_truth
from gtlayout.method import solve
from gtlayout.solution import Solution

app = new_app("closing", __doc__)


@app.default
def measure(*roots: Annotated[Path, Parameter(name="SCENE")], out: Path, jobs: Jobs = 1) -> None:
    """Solve synthetic rooms, close them, and compare with their outlines. A run that was cut short goes on.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where the table and the results of each scene go.
    jobs
        Scenes at a time.
    """
    scenes = {f"{folder}-{name}": path for folder, of in scenes_by_folder(roots).items() for name, path in of.items()}
    measured = run_scenes(scenes, out, measure_scene, "closing", jobs)
    table = {label: shares(rows) for label, rows in pooled(list(measured.values())).items()}
    write_tables(out, "closing", table, "surfaces")
    print(markdown_table(table, "surfaces"), end="")


def measure_scene(folder: Path) -> SceneRows:
    """Label → areas of one scene. Raises GtlayoutError when it has no truth or cannot be solved."""
    return areas(close(solve(load_scene(folder))))


def areas(closed: Solution) -> SceneRows:
    """Label → area added, the part of it that is right, and the area that nobody saw; square world units."""
    scene, layout = closed.scene, closed.layout
    truth = read_truth(scene)
    if truth is None:
        raise GtlayoutError(f"{scene.root} has no {FILE}")
    outlines = read_json(scene.root / FILE)["planes"]
    sums: dict[str, list[float]] = {}
    for name, i in match_instances(layout, truth).items():
        if layout.instances[i].host is None and layout.planes[i].observable:
            extent, inferred = layout.extents[i], layout.inferred[i].region
            true = polygons(extent.frame.region([[np.asarray(outlines[name]["outline"])]]))
            found = inferred.area, inferred.intersection(true).area, true.difference(extent.region).area
            for label in ("all", outlines[name]["label"]):
                sums[label] = [a + b for a, b in zip(sums.get(label, [0.0, 0.0, 0.0]), found, strict=True)]
    keys = ("added", "right", "unseen")
    return {
        label: [Metric(key, value, "m2", None) for key, value in zip(keys, values, strict=True)]
        for label, values in sums.items()
    }


def pooled(scenes: list[SceneRows]) -> SceneRows:
    """The areas of all scenes together."""
    table: SceneRows = {}
    for label in sorted({label for rows in scenes for label in rows}):
        rows = [scene[label] for scene in scenes if label in scene]
        table[label] = [Metric(m[0].key, sum(one.value for one in m), "m2", None) for m in zip(*rows, strict=True)]
    return table


def shares(row: list[Metric]) -> list[Metric]:
    """The areas, the share of what is added that is right, and the share of what nobody saw that is recovered."""
    added, right, unseen = (metric.value for metric in row)
    return [
        *row,
        Metric("right share", right / added if added else np.nan, "", True),
        Metric("recovered share", right / unseen if unseen else np.nan, "", True),
    ]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
