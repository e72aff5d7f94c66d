"""The command line: parses, calls, prints. Slow modules are imported only when a command needs them."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import App, ArgumentCollection, Parameter, Token
from cyclopts.validators import Number

from gtlayout.cli.console import (
    FROM_THE_FOLDER,
    SUSPICIOUS,
    NotNegative,
    Positive,
    Sources,
    exit_status,
    print_findings,
    print_notes,
    print_warnings,
    progress_bars,
    stdout,
)
from gtlayout.errors import GtlayoutError
from gtlayout.results.names import FOLDER, LOG_FILE, REPORT_FILE
from gtlayout.version import __version__
from gtlayout.viewer.process import WEB_PORT, open_log, serve_log
from gtlayout.viewer.session import RerunMode, rerun_observer

app = App(
    name="gtlayout",
    help="Room planes with uncertainty, a mesh and a verdict, from posed video and 2D annotations.",
    help_epilogue="Exit status: 0 done, 1 known problem (one line on stderr), 2 wrong usage, 3 something suspicious "
    "(check, review) or some scenes failed (batch), 130 interrupted.",
    version=__version__,
    suppress_keyboard_interrupt=False,
)

SceneDir = Annotated[Path, Parameter(name="DIR")]


@app.command
def solve(
    scene_dir: SceneDir,
    /,
    *,
    close: Annotated[bool, Parameter(negative=())] = False,
    out: Path | None = None,
    raft_weights: Path | None = None,
    refine_cameras: bool = True,
    rerun: RerunMode = "off",
    restarts: Positive = 1,
    seed: NotNegative = 0,
    sources: Sources = FROM_THE_FOLDER,
    verbose: Annotated[bool, Parameter(name=("--verbose", "-v"), negative=())] = False,
) -> None:
    """Reconstruct the room in a scene folder.

    The folder holds images or a video, cameras and annotations, in any of the known formats. The command writes
    layout.json (planes, covariances, extents, dimensions, mesh), layout.glb, layout.ply, quality.json, review.json
    (drawings that are probably wrong), config.json and timings.json. A scene that fails leaves no files. Refined
    cameras are written to cameras.json.

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
    verbose
        Print stage timings and every warning.
    """
    out_dir = _results_dir(out or scene_dir / FOLDER)

    from gtlayout.api import load, save
    from gtlayout.closing.close import close as close_room
    from gtlayout.config import Config
    from gtlayout.method import solve as solve_scene
    from gtlayout.results.tables import camera_line, dimensions, headline_text, instance_table, measures, reasons
    from gtlayout.review.review import review as review_drawings
    from gtlayout.tracking.config import TrackingConfig

    tracking = TrackingConfig(raft_weights=None if raft_weights is None else str(raft_weights))
    config = Config(tracking=tracking, seed=seed, refine_cameras=refine_cameras, restarts=restarts)
    scene = load(scene_dir, **vars(sources))
    with progress_bars() as progress, rerun_observer(rerun, out_dir / LOG_FILE, progress) as observer:
        solution = solve_scene(scene, config, observer)
        if close:
            observer.stage("closing")
            solution = close_room(solution)
        observer.stage("review")
        findings = review_drawings(solution)
        save(solution, out_dir, findings)

    console = stdout()
    console.print(headline_text(solution.quality.headline))
    console.print(instance_table(solution.layout, solution.quality))
    for reason in reasons(solution.layout, solution.quality):
        console.print(reason, style="yellow")
    for dimension in dimensions(solution.layout):
        console.print(dimension)
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


@app.command
def evaluate(
    scene_dir: SceneDir,
    /,
    *,
    layout: Path | None = None,
    json: Path | None = None,
    sources: Sources = FROM_THE_FOLDER,
) -> None:
    """Compare a solved layout with the annotations and, where the scene has them, with depth/ and gt_planes.json.

    Images and depth are compared through the cameras that the layout was solved with, also when these are refined.
    Planes are compared in the world of the scene's own cameras.

    Parameters
    ----------
    scene_dir
        The scene folder.
    layout
        Folder that holds layout.json; DIR/gtlayout when not given.
    json
        Write the figures to this file, too.
    """
    from gtlayout.api import load_solved
    from gtlayout.evaluation.evaluate import evaluate as evaluate_layout
    from gtlayout.io.files import write_json_atomic
    from gtlayout.results.tables import evaluation_table, headline_text

    evaluation = evaluate_layout(*load_solved(scene_dir, layout, **vars(sources)))
    console = stdout()
    console.print(headline_text(evaluation.headline))
    console.print(evaluation_table(evaluation))
    if json is not None:
        write_json_atomic(json, asdict(evaluation))


@app.command
def check(scene_dir: SceneDir, /, *, sources: Sources = FROM_THE_FOLDER) -> int:
    """List everything suspicious in a scene folder, before it is solved: one line each, then how many.

    It checks images, annotations, whether the cameras fit the images (axes, inverted poses, timestamps), their unit and
    their motion. It writes nothing.

    Parameters
    ----------
    scene_dir
        The scene folder.
    """
    from gtlayout.api import load
    from gtlayout.check import contents, suspicions

    scene = load(scene_dir, **vars(sources))
    with progress_bars() as progress:
        progress.stage("images")
        found = suspicions(scene, progress.progress)
    console = stdout()
    for line in found:
        console.print(line, style="yellow")
    print_notes(console, scene.notes)
    counted = f"{len(found)} warning{'s' if len(found) > 1 else ''}" if found else "nothing suspicious"
    console.print(f"{counted}: {contents(scene)}")
    return SUSPICIOUS if found else 0


@app.command
def view(
    scene_dir: SceneDir,
    /,
    *,
    layout: Path | None = None,
    web: Annotated[bool, Parameter(negative=())] = False,
    port: Annotated[int, Parameter(validator=Number(gte=1, lte=65534))] = WEB_PORT,
) -> None:
    """Open the log of `solve --rerun save` in the rerun viewer.

    Parameters
    ----------
    scene_dir
        The scene folder.
    layout
        Folder that holds log.rrd; DIR/gtlayout when not given.
    web
        Serve the web viewer to browsers on this machine, and print its address, until Ctrl-C.
    port
        With --web: the port to serve it on. The log uses the port after it.
    """
    log = (layout or scene_dir / FOLDER) / LOG_FILE
    if web:
        serve_log(log, port, lambda address: stdout().print(f"{address}\nCtrl-C stops"))
    else:
        open_log(log)


@app.command
def report(
    scene_dir: SceneDir,
    /,
    *,
    layout: Path | None = None,
    against: Path | None = None,
    out: Path | None = None,
    sources: Sources = FROM_THE_FOLDER,
) -> None:
    """Write a page about a solved layout: verdict, instances, 3D view, annotated frames, timings, configuration.

    It is one HTML file that needs no network and fits a phone. For a run of `batch` it is a page about all scenes, the
    worst first, with links to their pages.

    Parameters
    ----------
    scene_dir
        The scene folder, or the folder of a run.
    layout
        Folder that holds layout.json; DIR/gtlayout when not given.
    against
        For a run: the folder of another run, to show which scenes are better and which are worse.
    out
        The file to write; report.html beside layout.json, or in the folder of the run, when not given.
    """
    from gtlayout.batch.page.run_page import write_run_report
    from gtlayout.batch.run_folder import is_run
    from gtlayout.report.files import write_report

    of_run = is_run(scene_dir)
    for_one = {"layout": layout, **vars(sources)}
    if of_run and (given := [name for name, value in for_one.items() if value is not None]):
        raise GtlayoutError(f"--{given[0]} is for one scene, and {scene_dir} is a run")
    if against is not None and not of_run:
        raise GtlayoutError(f"--against compares two runs, and {scene_dir} is none")
    folder = scene_dir if of_run else layout or scene_dir / FOLDER
    page = out or folder / REPORT_FILE
    with progress_bars() as progress:
        progress.stage("report")
        if of_run:
            write_run_report(scene_dir, page, against)
        else:
            write_report(scene_dir, folder, page, progress.progress, **vars(sources))
    stdout().print(f"Report: {page}")


def _one_cluster(scheduler: str | None = None, **local: object) -> None:
    if scheduler is not None and not local.keys().isdisjoint(("workers", "memory_limit")):
        raise ValueError("--workers and --memory-limit are of this machine; a cluster with --scheduler has its own")


app.command(
    "gtlayout.cli.batch:batch",
    validator=_one_cluster,
    help="Solve every scene in folders of scenes, in parallel; go on where an earlier run was cut short.",
)


def _note_given(_app: App, _commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Tell `synth` which fields stand on the command line: what is given holds for all rooms, even a default."""
    for name in [argument.field_info.name for argument in arguments if argument.keys and argument.tokens]:
        arguments["--given"].append(Token(value=name, source="given", index=len(arguments["--given"].tokens)))


app.command(
    "gtlayout.cli.synth:synth",
    name="synth",
    config=_note_given,
    help="Make a synthetic furnished room with known truth: images, cameras, annotations, depth and true planes.",
)


app.command(
    "gtlayout.cli.review:review",
    name="review",
    help="Solve a scene, and list the drawings that are probably wrong, the worst first, by frame and element.",
)


app.command(
    "gtlayout.cli.export:export",
    name="export",
    help="Write a solved layout for another program: a viewer, CAD, a data set.",
)


app.command(
    "gtlayout.cli.serve:serve",
    name="serve",
    help="Propose drawings in Label Studio: a backend for its models, until Ctrl-C.",
)


app.command(
    "gtlayout.cli.propose:propose",
    name="propose",
    help="Propose the drawings of frames that are not drawn yet, to be corrected instead of drawn.",
)


def _source_or_labels(source: Path | None = None, out: Path | None = None, **options: object) -> None:
    if "label_config" not in options and (source is None or out is None):
        raise ValueError("SRC and OUT are needed (or --label-config cvat|label-studio)")


app.command(
    "gtlayout.cli.import_:import_",
    name="import",
    validator=_source_or_labels,
    help="Turn cameras, video and annotations of any known format into a scene folder, undistorted.",
)


app.command(
    "gtlayout.cli.annotate:annotate",
    name="annotate",
    help="Draw a scene in the browser while it is solved: prints the address of the page, and serves it until Ctrl-C.",
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments, "interrupted")


def _results_dir(out_dir: Path) -> Path:
    """``out_dir``, checked before the work rather than after it."""
    if out_dir.exists() and not out_dir.is_dir():
        msg = f"results cannot go to {out_dir}: it is a file, not a folder"
        raise GtlayoutError(msg)
    return out_dir
