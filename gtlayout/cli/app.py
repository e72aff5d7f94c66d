"""The command line: parses, calls, prints. Slow modules are imported only when a command needs them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, TypeVar

from cyclopts import App, ArgumentCollection, Group, Parameter, Token
from cyclopts.validators import Number

from gtlayout.cli.console import (
    FROM_THE_FOLDER,
    SUSPICIOUS,
    AsJson,
    Folder,
    NewFile,
    SceneDir,
    Sources,
    exit_status,
    print_next,
    print_notes,
    progress_bars,
    stdout,
)
from gtlayout.cli.help_text import help_text
from gtlayout.cli.solve import solve
from gtlayout.errors import GtlayoutError
from gtlayout.results.names import FOLDER, LOG_FILE, REPORT_FILE
from gtlayout.version import __version__
from gtlayout.viewer.process import WEB_PORT, open_log, serve_log

app = App(
    name="gtlayout",
    help="Room planes with uncertainty, a mesh and a verdict, from posed video and 2D annotations.",
    help_epilogue="Exit status: 0 done, 1 known problem (one line on stderr), 2 wrong usage, 3 something suspicious "
    "(check, review) or some scenes failed (batch), 130 interrupted, 143 terminated.\n\n"
    "In this order: import, annotate, check, solve, report. gtlayout COMMAND --help shows an example of each.",
    version=__version__,
    suppress_keyboard_interrupt=False,
    group_commands=Group("This program", sort_key=9),
)

MAKE, DRAW, SOLVE, LOOK = (
    Group(name, sort_key=number)
    for number, name in enumerate(("Get a scene", "Draw it", "Solve it", "Look at results"))
)
Command = TypeVar("Command", bound=Callable[..., int | None])
_DONE = "Exit status: 0 done, 1 known problem, 2 wrong usage"


def _in(group: Group, place: int, example: str, status: str = _DONE) -> dict[str, Any]:
    """Where a command stands in the help, and what ends its own."""
    return {"group": group, "sort_key": place, "help_epilogue": f"Example: gtlayout {example}\n\n{status}."}


def _command(group: Group, place: int, example: str, status: str = _DONE) -> Callable[[Command], Command]:
    def add(command: Command) -> Command:
        app.command(command, **_in(group, place, example, status))
        return command

    return add


def _late(name: str, group: Group, place: int, example: str, status: str = _DONE, **options: Any) -> None:
    """Add a command whose module is imported when it is called, or when its own help is asked for."""
    module = "import_" if name == "import" else name
    options |= _in(group, place, example, status)
    app.command(f"gtlayout.cli.{module}:{module}", name=name, help=help_text(module), **options)


_command(SOLVE, 0, "solve room --out room/second")(solve)


@_command(LOOK, 2, "evaluate room --json > figures.json")
def evaluate(
    scene_dir: SceneDir,
    /,
    *,
    layout: Folder | None = None,
    json: AsJson = False,
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
    """
    from gtlayout.api import load_solved
    from gtlayout.evaluation.evaluate import evaluate as evaluate_layout
    from gtlayout.io.files import json_text
    from gtlayout.results.tables import evaluation_table, headline_text

    evaluation = evaluate_layout(*load_solved(scene_dir, layout, **vars(sources)))
    console = stdout()
    if json:
        console.print(json_text(asdict(evaluation)), end="")
        return
    console.print(headline_text(evaluation.headline))
    console.print(evaluation_table(evaluation))


@_command(DRAW, 1, "check room", f"{_DONE}, 3 something is suspicious")
def check(scene_dir: SceneDir, /, *, json: AsJson = False, sources: Sources = FROM_THE_FOLDER) -> int:
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
    from gtlayout.io.files import json_text

    scene = load(scene_dir, **vars(sources))
    with progress_bars() as progress:
        progress.stage("images")
        found = suspicions(scene, progress.progress)
    console = stdout()
    if json:
        counts = {"frames": len(scene.frames), "key_frames": len(scene.key_frames)}
        counts["elements"] = sum(len(key_frame.elements) for key_frame in scene.key_frames)
        record = {"warnings": found, "notes": scene.notes, **counts, "metric": scene.metric}
        console.print(json_text(record), end="")
        return SUSPICIOUS if found else 0
    for line in found:
        console.print(line, style="yellow")
    print_notes(console, scene.notes)
    counted = f"{len(found)} warning{'s' if len(found) > 1 else ''}" if found else "nothing suspicious"
    console.print(f"{counted}: {contents(scene)}")
    print_next(console, "solve", scene_dir)
    return SUSPICIOUS if found else 0


@_command(LOOK, 1, "view room --web")
def view(
    scene_dir: SceneDir,
    /,
    *,
    layout: Folder | None = None,
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


@_command(LOOK, 0, "report room")
def report(
    scene_dir: SceneDir,
    /,
    *,
    layout: Folder | None = None,
    against: Folder | None = None,
    out: NewFile | None = None,
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
    from gtlayout.io.files import check_stays
    from gtlayout.report.files import write_report

    of_run = is_run(scene_dir)
    for_one = {"layout": layout, **vars(sources)}
    if of_run and (given := [name for name, value in for_one.items() if value is not None]):
        raise GtlayoutError(f"--{given[0]} is for one scene, and {scene_dir} is a run")
    if against is not None and not of_run:
        raise GtlayoutError(f"--against compares two runs, and {scene_dir} is none")
    folder = scene_dir if of_run else layout or scene_dir / FOLDER
    page = out or folder / REPORT_FILE
    if out is None:
        check_stays(folder, [REPORT_FILE])
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


def _note_given(_app: App, _commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Tell `synth` which fields stand on the command line: what is given holds for all rooms, even a default."""
    for name in [argument.field_info.name for argument in arguments if argument.keys and argument.tokens]:
        arguments["--given"].append(Token(value=name, source="given", index=len(arguments["--given"].tokens)))


def _source_or_labels(source: Path | None = None, out: Path | None = None, **options: object) -> None:
    if "label_config" not in options and (source is None or out is None):
        raise ValueError("SRC and OUT are needed (or --label-config cvat|label-studio)")


_late("batch", SOLVE, 3, "batch rooms --out run", f"{_DONE}, 3 some scenes failed", validator=_one_cluster)
_late("synth", MAKE, 1, "synth room --frames 24 --width 320 --height 240", config=_note_given)
_late("review", SOLVE, 1, "review room", f"{_DONE}, 3 something is probably wrong")
_late("measure", SOLVE, 2, "measure room --between floor_0 ceiling_0 2.513")
_late("export", LOOK, 3, "export room --to ifc --out room.ifc")
_late("serve", DRAW, 3, "serve --label-studio room")
_late("propose", DRAW, 2, "propose room --next 3")
_late("import", MAKE, 0, "import clip.mp4 room --colmap", validator=_source_or_labels)
_late("annotate", DRAW, 0, "annotate room")
app.register_install_completion_command(
    help="Have the shell complete commands and options: writes its completion file, and a line in its startup file.",
    help_flags=[],
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments, "interrupted")
