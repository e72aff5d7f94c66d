"""What the commands share: how they print, show progress and end."""

from __future__ import annotations

import codecs
import os
import shlex
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from difflib import get_close_matches
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, CycloptsError, Parameter, UnknownCommandError, UnusedCliTokensError
from cyclopts.validators import Number
from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
from rich.text import Text

from gtlayout.errors import GtlayoutError
from gtlayout.extras import MissingExtraError
from gtlayout.observer import Observer
from gtlayout.signals import ending

if TYPE_CHECKING:
    from gtlayout.review.findings import Finding

WRONG_USAGE = 2
INTERRUPTED = 130
"""Exit status after Ctrl-C."""
SUSPICIOUS = 3
"""Exit status of a check or a review that found something."""
SHOWN_WARNINGS = 5
"""More than these are only counted, unless -v is given."""
LONG_S = 5.0
"""What takes longer says how much time is left."""
Positive = Annotated[int, Parameter(validator=Number(gte=1))]
NotNegative = Annotated[int, Parameter(validator=Number(gte=0))]


def _can_be_made(_type: object, place: Path | None) -> None:
    """Raises GtlayoutError, before any work is done, where nothing can be written to ``place``: the folder that it is
    to lie in is not there, or may not be written to, or it is a link that leads to itself.
    """
    if place is not None and place.is_symlink() and Path(os.path.realpath(place)).is_symlink():
        raise GtlayoutError(f"cannot write {place}: it is a link that leads to itself")
    if place is not None and not place.parent.is_dir():
        what = "a file, not a folder" if place.parent.exists() else "not there"
        raise GtlayoutError(f"cannot write {place}: {place.parent} is {what}")
    if place is not None:
        require_writable(place)


def require_writable(place: Path) -> None:
    """Raises GtlayoutError where this user may not write the file or folder ``place``."""
    folder = place if place.is_dir() else place.parent
    if (folder == place or not place.exists() or place.is_file()) and not os.access(folder, os.W_OK | os.X_OK):
        raise GtlayoutError(f"cannot write {place}: Permission denied for {folder}")


def _is_folder(_type: object, place: Path | None) -> None:
    if place is not None and place.is_file():
        raise GtlayoutError(f"{place} is a file, where a folder is wanted")


SceneDir = Annotated[Path, Parameter(name="DIR", validator=_is_folder)]
NewFile = Annotated[Path, Parameter(validator=_can_be_made)]
"""A file or folder to write."""
NewFolder = Annotated[Path, Parameter(validator=(_is_folder, _can_be_made))]
Folder = Annotated[Path, Parameter(validator=_is_folder)]
AsJson = Annotated[
    bool, Parameter(name="--json", negative=(), help="Print one JSON document, and nothing else, on standard output.")
]


@Parameter(name="*")
@dataclass(frozen=True)
class Sources:
    """What a scene is read from, where it holds several or they lie elsewhere."""

    cameras: Annotated[
        Path | None,
        Parameter(help="Camera file, or folder of a COLMAP model, to read; a path, or one within the scene folder."),
    ] = None
    annotations: Annotated[
        Path | None,
        Parameter(help="File, zip or folder of annotations to read; a path, or one within the scene folder."),
    ] = None


FROM_THE_FOLDER = Sources()


def exit_status(app: App, arguments: list[str] | None, when_interrupted: str) -> int:
    """Run a command line and return its exit status: the command's own, or 0 when it returns none.

    Unknown exceptions are bugs and keep their traceback.
    """
    name = app.name[0]
    try:
        status = app(arguments, exit_on_error=False, print_error=False, console=_Output(), result_action="return_value")
    except CycloptsError as error:
        print(f"{name}: {usage_problem(app, error)}", file=sys.stderr)
        return WRONG_USAGE
    except MissingExtraError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return WRONG_USAGE
    except GtlayoutError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    except PermissionError as error:
        print(f"{name}: cannot use {error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as error:
        word, status = ending(error)
        print(f"{name}: {when_interrupted if status == INTERRUPTED else word}", file=sys.stderr)
        return status
    return status if isinstance(status, int) else 0


def usage_problem(app: App, error: CycloptsError) -> str:
    """What is wrong with a command line, in one line: what was not understood, and what was meant perhaps."""
    chain = list(error.command_chain or ())
    left = list(error.unused_tokens or ())
    if isinstance(error, UnusedCliTokensError) and left:
        what = f"{'one' if len(left) == 1 else len(left)} {'folder' if chain[-1:] != ['serve'] else 'word'}"
        problem = f"{what}{'' if len(left) == 1 else 's'} too many: {' '.join(left)}"
    elif isinstance(error, UnknownCommandError) and left:
        known = [name for name in app if name.startswith("-") == left[0].startswith("-")]
        meant = get_close_matches(left[0], known, n=1, cutoff=0.7)
        kind = "option" if left[0].startswith("-") else "command"
        problem = f"unknown {kind} {left[0]}" + (f": did you mean {meant[0]}?" if meant else "")
    else:
        error.verbose = False
        problem = " ".join(str(error).split())
        problem = problem[:1].lower() + problem[1:]
    return f"{problem.rstrip('.')} ({' '.join([app.name[0], *chain])} --help says more)"


class _Output(Console):
    """Standard output: what cannot be printed is a known problem."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Raises GtlayoutError when the disk is full, or whatever else takes the text does not."""
        try:
            super().print(*objects, **options)
        except OSError as error:
            # What is left in the buffer would be tried again when Python ends.
            with Path(os.devnull).open("w") as nowhere, suppress(OSError, ValueError):
                os.dup2(nowhere.fileno(), sys.stdout.fileno())
            raise GtlayoutError(f"cannot print: {error.strerror or error}") from error


def stdout() -> Console:
    """Prints text as it is, in notebooks too, and never wrapped: paths and names stay whole in a log."""
    return _Output(highlight=False, markup=False, soft_wrap=True, force_jupyter=False)


_ASCII = {"σ": "sigma", "ε": "eps", "χ": "chi", "±": "+-", "²": "2", "³": "3", "°": "deg", "×": "x", "…": "..."}
_ASCII |= {"–": "-", "→": "->", "·": "*", "─": "-", "µ": "u", "≤": "<=", "≥": ">="}


def print_any_sign() -> None:
    """Standard output and error take every sign from now on: what they lack is written in ASCII, or as ``?``."""

    def in_ascii(error: UnicodeError) -> tuple[str, int]:
        assert isinstance(error, UnicodeEncodeError)
        return "".join(_ASCII.get(sign, "?") for sign in error.object[error.start : error.end]), error.end

    codecs.register_error("gtlayout", in_ascii)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="gtlayout")


def print_warnings(console: Console, warnings: Sequence[str], verbose: bool) -> None:
    """Print the first warnings, or all of them."""
    shown = warnings if verbose else warnings[:SHOWN_WARNINGS]
    for warning in shown:
        console.print(f"warning: {warning}", style="yellow")
    if len(shown) < len(warnings):
        console.print(f"… and {len(warnings) - len(shown)} more warnings (see them with -v)", style="yellow")


def print_notes(console: Console, notes: Sequence[str]) -> None:
    """Print what is in order and still worth knowing."""
    for note in notes:
        console.print(f"note: {note}")


def print_next(console: Console, *command: str | Path) -> None:
    """Print what to call next, as it can be pasted into a shell."""
    console.print(f"next: gtlayout {shlex.join(map(str, command))}", style="dim")


def print_findings(console: Console, findings: Sequence[Finding], verbose: bool) -> None:
    """Print the worst findings of a review, or all of them."""
    shown = findings if verbose else findings[:SHOWN_WARNINGS]
    for finding in shown:
        console.print(f"{finding.kind}: {finding.line}", style="yellow")
    if len(shown) < len(findings):
        console.print(f"… and {len(findings) - len(shown)} more findings (see them with -v)", style="yellow")


class ProgressBars(Observer):
    """One bar a stage."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self.reached = "the beginning"
        """The stage that began last."""

    def stage(self, name: str) -> None:
        """Complete the bar of the stage before and begin a new one."""
        self.finish()
        self.reached = name
        self._bars.add_task(name, total=None)

    def progress(self, done: int, total: int) -> None:
        """Move the bar."""
        self._bars.update(self._bars.task_ids[-1], completed=done, total=total)

    def finish(self) -> None:
        """Complete the last bar."""
        for task in self._bars.tasks:
            if not task.finished:
                self._bars.update(task.id, total=max(task.completed, 1), completed=max(task.completed, 1))


class _Steps(ProgressColumn):
    """``3/24``, once it is known of how many."""

    def render(self, task: Task) -> Text:
        return Text("" if task.total is None else f"{task.completed:.0f}/{task.total:.0f}")


class _TimeLeft(ProgressColumn):
    """Of what takes more than ``LONG_S``."""

    def render(self, task: Task) -> Text:
        left_s = task.time_remaining
        if task.finished or left_s is None or (task.elapsed or 0) < LONG_S:
            return Text("")
        return Text(f"{left_s // 60:.0f}:{left_s % 60:02.0f} left")


@contextmanager
def progress_bars() -> Iterator[ProgressBars]:
    """Progress bars on stderr; nothing when that is not a terminal."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description:<16}"), BarColumn(), _Steps(), TimeElapsedColumn(), _TimeLeft())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:
        observer = ProgressBars(bars)
        yield observer
        observer.finish()


class _TimeIsUp(KeyboardInterrupt):
    """No stage takes it for a problem of its own."""


@contextmanager
def time_limit(timeout_s: float | None, progress: ProgressBars) -> Iterator[None]:
    """Raises GtlayoutError, which says what was reached, when what is done within takes longer."""
    if timeout_s is None:
        yield
        return

    def up(*_: object) -> None:
        raise _TimeIsUp

    before = signal.signal(signal.SIGALRM, up)
    signal.setitimer(signal.ITIMER_REAL, timeout_s)
    try:
        yield
    except _TimeIsUp:
        raise GtlayoutError(
            f"not done in {timeout_s:g} s: stopped in {progress.reached}, nothing was written"
        ) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
