"""What the commands share: how they print, show progress and end."""

from __future__ import annotations

import codecs
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, CycloptsError, Parameter
from cyclopts.validators import Number
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from gtlayout.errors import GtlayoutError
from gtlayout.observer import Observer
from gtlayout.signals import ending

if TYPE_CHECKING:
    from gtlayout.review.findings import Finding

INTERRUPTED = 130
"""Exit status after Ctrl-C."""
SUSPICIOUS = 3
"""Exit status of a check or a review that found something."""
SHOWN_WARNINGS = 5
"""More than these are only counted, unless -v is given."""
Positive = Annotated[int, Parameter(validator=Number(gte=1))]
NotNegative = Annotated[int, Parameter(validator=Number(gte=0))]


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
        status = app(
            arguments,
            exit_on_error=False,
            console=_Output(),
            error_console=Console(stderr=True),
            result_action="return_value",
        )
    except CycloptsError:
        return 2
    except GtlayoutError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as error:
        word, status = ending(error)
        print(f"{name}: {when_interrupted if status == INTERRUPTED else word}", file=sys.stderr)
        return status
    return status if isinstance(status, int) else 0


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


def print_findings(console: Console, findings: Sequence[Finding], verbose: bool) -> None:
    """Print the worst findings of a review, or all of them."""
    shown = findings if verbose else findings[:SHOWN_WARNINGS]
    for finding in shown:
        console.print(f"{finding.kind}: {finding.line}", style="yellow")
    if len(shown) < len(findings):
        console.print(f"… and {len(findings) - len(shown)} more findings (see them with -v)", style="yellow")


class _ProgressBars(Observer):
    """One bar a stage."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars

    def stage(self, name: str) -> None:
        """Complete the bar of the stage before and begin a new one."""
        self.finish()
        self._bars.add_task(name, total=None)

    def progress(self, done: int, total: int) -> None:
        """Move the bar."""
        self._bars.update(self._bars.task_ids[-1], completed=done, total=total)

    def finish(self) -> None:
        """Complete the last bar."""
        for task in self._bars.tasks:
            if not task.finished:
                self._bars.update(task.id, total=max(task.completed, 1), completed=max(task.completed, 1))


@contextmanager
def progress_bars() -> Iterator[Observer]:
    """Progress bars on stderr; nothing when that is not a terminal."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description:<16}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:
        observer = _ProgressBars(bars)
        yield observer
        observer.finish()
