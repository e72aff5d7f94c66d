"""The review of drawings: how many planted errors it names, and how many right drawings it suspects.

Each scene is solved as it is, and again with one error planted in one key frame at a time: labels swapped, an element
left out, the polygon of another frame, an occlusion edge dropped, an edge shifted by 15 or 30 px (of an image of
640x480) in both its elements. The further solves take the tracks of the first, without points that would not have been
sampled on the wrong drawing. An error is named when a finding of its key frame, that the scene as it is does not have,
names one of the wrong elements; an element that is left out, when the finding lies mostly where it was.

Gaps are counted apart: they are measured, not suspected, and whether one is meant only the annotator knows.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number
from shapely import Polygon
from threadpoolctl import threadpool_limits

from common.command_line import Jobs, exit_status, new_app
from common.metrics import Metric, markdown_table, write_tables
from common.runner import SceneRows, run_scenes, scenes_by_folder
from common.solve_again import solve_again
from gtlayout.errors import GtlayoutError
from gtlayout.geometry.polygons import polygons
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve
from gtlayout.review.findings import Finding
from gtlayout.review.review import review
from simulated.wrong_drawings import WrongDrawing, wrong_drawings

RESULTS = Path(__file__).with_name("results") / "review"
CLEAN = "as drawn"
"""Label of the row of scenes without a planted error."""

app = new_app("review", __doc__)


@app.default
def measure(
    *roots: Annotated[Path, Parameter(name="SCENE")],
    out: Path = RESULTS,
    count: Annotated[int, Parameter(validator=Number(gte=1))] = 4,
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    jobs: Jobs = 1,
) -> None:
    """Plant errors in scenes and write how many are named, as a table. A run that was cut short goes on where it was.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where the table and the results of each scene go.
    count
        Errors of each kind in a scene, if there are places for as many.
    seed
        Of the choice of places.
    jobs
        Scenes at a time.
    """
    scenes = {f"{folder}-{name}": path for folder, of in scenes_by_folder(roots).items() for name, path in of.items()}
    measured = run_scenes(scenes, out, partial(of_scene, count=count, seed=seed), f"count {count}, seed {seed}", jobs)
    table = pooled(list(measured.values()))
    write_tables(out, "review", table, "error")
    print(markdown_table(table, "error"), end="")


def of_scene(folder: Path, count: int, seed: int) -> SceneRows:
    """Kind of error → counts, for one scene."""
    with threadpool_limits(limits=1, user_api="blas"):
        solution = solve(load_scene(folder))
        as_drawn = solve_again(solution, solution.scene)
        known = review(as_drawn)
        suspected = {one.key_frame for one in known if one.kind != "gap"}
        gaps = {one.key_frame for one in known if one.kind == "gap"}
        rows = {CLEAN: [_counted("drawings", len(solution.scene.key_frames)), _counted("suspected", len(suspected))]}
        rows[CLEAN].append(_counted("with a gap", len(gaps)))
        outcomes: dict[str, list[tuple[bool, int]]] = {}
        for wrong in wrong_drawings(solution, count, seed):
            try:
                findings = new_findings(review(solve_again(as_drawn, wrong.scene)), known)
            except GtlayoutError:
                findings = ()  # A scene that cannot be solved any more names nothing.
            elsewhere = {one.key_frame for one in findings if one.kind != "gap"} - {wrong.key_frame}
            outcomes.setdefault(wrong.kind, []).append((is_named(wrong, findings), len(elsewhere)))
    for kind, found in outcomes.items():
        named, elsewhere_count = (sum(values) for values in zip(*found, strict=True))
        rows[kind] = [
            _counted("planted", len(found)),
            _counted("named", named),
            _counted("others suspected", elsewhere_count),
        ]
    return rows


def new_findings(findings: Sequence[Finding], known: Sequence[Finding]) -> tuple[Finding, ...]:
    """Those that say something of an element that was not said before."""
    before = {(one.key_frame, one.kind, one.element_id) for one in known}
    return tuple(one for one in findings if (one.key_frame, one.kind, one.element_id) not in before)


def is_named(wrong: WrongDrawing, findings: Sequence[Finding]) -> bool:
    """Whether one of the findings names a planted error."""
    here = [one for one in findings if one.key_frame == wrong.key_frame]
    if wrong.region_px.is_empty:
        return any(one.element_id in wrong.elements for one in here)
    missing = [polygons(Polygon(one.where_px)) for one in here if one.kind in {"missing", "gap"}]
    return any(region.intersection(wrong.region_px).area > region.area / 2 for region in missing)


def pooled(scenes: Sequence[Mapping[str, Sequence[Metric]]]) -> SceneRows:
    """The counts of all scenes together, with their shares."""
    table: SceneRows = {}
    for kind in dict.fromkeys(kind for rows in scenes for kind in rows):
        sums: dict[str, float] = {}
        for metric in (metric for rows in scenes for metric in rows.get(kind, ())):
            sums[metric.key] = sums.get(metric.key, 0.0) + metric.value
        whole = next(iter(sums))
        shares = [
            Metric(f"{key}, share", value / sums[whole], "", key == "named")
            for key, value in sums.items()
            if key != whole
        ]
        table[kind] = [*(Metric(key, value, "", None) for key, value in sums.items()), *shares]
    return table


def _counted(key: str, value: int) -> Metric:
    return Metric(key, float(value), "", None)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
