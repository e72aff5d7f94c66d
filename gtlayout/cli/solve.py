"""The command ``solve``. What it needs is imported when it runs: its help does not wait for OpenCV and GTSAM."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from gtlayout.cli.console import (
    FROM_THE_FOLDER,
    AsJson,
    NewFolder,
    NotNegative,
    Positive,
    SceneDir,
    Sources,
    print_findings,
    print_next,
    print_notes,
    print_warnings,
    progress_bars,
    require_writable,
    stdout,
    time_limit,
)
from gtlayout.errors import GtlayoutError
from gtlayout.results.names import FOLDER, LOG_FILE
from gtlayout.viewer.session import RerunMode, rerun_observer

MAX_TIMEOUT_S = 1e7


def solve(
    scene_dir: SceneDir,
    /,
    *,
    close: Annotated[bool, Parameter(negative=())] = False,
    out: NewFolder | None = None,
    raft_weights: Path | None = None,
    refine_cameras: bool = True,
    rerun: RerunMode = "off",
    restarts: Positive = 1,
    seed: NotNegative = 0,
    loa: Literal[10, 20, 30, 40] = 20,
    timeout: Annotated[float | None, Parameter(validator=Number(gt=0, lte=MAX_TIMEOUT_S))] = None,
    json: AsJson = False,
    sources: Sources = FROM_THE_FOLDER,
    verbose: Annotated[bool, Parameter(name=("--verbose", "-v"), negative=())] = False,
) -> None:
    """Reconstruct the room in a scene folder.

    The folder holds images or a video, cameras and annotations, in any of the known formats. The command writes
    layout.json (planes, covariances, extents, dimensions, mesh), layout.glb, layout.ply, quality.json, review.json
    (drawings that are probably wrong), evidence.json (what each plane rests on), config.json and timings.json. A scene
    that fails leaves no files. Corrected or refined cameras are written to cameras.json.

    Parameters
    ----------
    scene_dir
        The scene folder.
    close
        Close the room where nobody looked: a layer "inferred" beside what was seen, which no figure counts.
    out
        Where results go; DIR/gtlayout when not given.
    raft_weights
        Follow points with RAFT's dense flow instead of Lucas-Kanade: file with the weights of torchvision's raft_small.
        Needs pip install 'gtlayout[raft]'.
    refine_cameras
        Adjust the camera poses first to what is seen in the images. The result is kept only if it is clearly better on
        points that were left out; --no-refine-cameras keeps the given poses in any case.
    rerun
        Log each stage for the rerun viewer: save log.rrd beside the results, spawn a viewer, or connect to one.
    restarts
        Solve this many times, all but the first on random subsets of the tracks, and keep the best IoU.
    seed
        Seed of all random numbers. The same seed gives the same bytes on one kind of processor.
    loa
        The level of accuracy (USIBD) that surfaces and dimensions are held against: at 95 %, 10 is 15 cm, 20 is 5 cm,
        30 is 15 mm, 40 is 5 mm.
    timeout
        Seconds after which the solve is stopped. It then says in which stage, and writes nothing.
    verbose
        Print stage timings and every warning.
    """
    out_dir = out or scene_dir / FOLDER
    if out is None and out_dir.exists() and not out_dir.is_dir():
        raise GtlayoutError(f"results cannot go to {out_dir}: it is a file, not a folder")
    if scene_dir.is_dir():
        require_writable(out_dir)

    from gtlayout.api import load, save
    from gtlayout.closing.close import close as close_room
    from gtlayout.config import Config
    from gtlayout.io.files import json_text
    from gtlayout.method import solve as solve_scene
    from gtlayout.results.layout_files import solution_record
    from gtlayout.results.tables import (
        camera_line,
        dimensions,
        headline_text,
        instance_table,
        measurement_lines,
        measures,
        reasons,
    )
    from gtlayout.review.review import review as review_drawings
    from gtlayout.tracking.config import TrackingConfig

    tracking = TrackingConfig(raft_weights=None if raft_weights is None else str(raft_weights))
    config = Config(tracking=tracking, seed=seed, refine_cameras=refine_cameras, restarts=restarts, loa=loa)
    with progress_bars() as progress, rerun_observer(rerun, out_dir / LOG_FILE, progress) as observer:
        with time_limit(timeout, progress):
            observer.stage("reading")
            scene = load(scene_dir, **vars(sources))
            solution = solve_scene(scene, config, observer)
            if close:
                observer.stage("closing")
                solution = close_room(solution)
                observer.inferred(solution.layout)
            observer.stage("review")
            findings = review_drawings(solution)
        save(solution, out_dir, findings)

    console = stdout()
    if json:
        console.print(json_text(solution_record(solution, findings, out_dir)), end="")
        return
    console.print(headline_text(solution.quality.headline))
    console.print(instance_table(solution.layout, solution.quality, console.width if console.is_terminal else None))
    for reason in reasons(solution.layout, solution.quality):
        console.print(reason, style="yellow")
    for line in (*dimensions(solution.layout), *measurement_lines(solution.layout)):
        console.print(line)
    if solution.cameras is not None and (solution.cameras.refined or verbose):
        console.print(camera_line(solution.cameras, scene.metric))
    print_warnings(console, solution.scene.warnings, verbose)
    print_notes(console, solution.scene.notes)
    print_findings(console, findings, verbose)
    if verbose:
        for stage, seconds in solution.timings_s.items():
            console.print(f"{stage:<16}{seconds:8.2f} s")
    console.print(measures(solution.scene, solution.layout, solution.quality))
    console.print(f"Results: {out_dir}")
    print_next(console, "report", scene_dir, *(() if out is None else ("--layout", out)))
