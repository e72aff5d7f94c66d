"""What the command lines of all scripts share."""

from __future__ import annotations

import sys
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter
from cyclopts.validators import Number
from rich.console import Console

from gtlayout.errors import GtlayoutError

Jobs = Annotated[int, Parameter(validator=Number(gte=1))]
"""Scenes at a time."""


def new_app(name: str, purpose: str | None) -> App:
    """A command line with one command."""
    return App(
        name=name,
        help=purpose,
        help_epilogue="Exit status: 0 done, 1 known problem (one line on stderr), 2 wrong usage, 130 interrupted.",
        version_flags=(),
        suppress_keyboard_interrupt=False,
    )


def exit_status(app: App, arguments: list[str] | None) -> int:
    """Run the command line; known problems are one line on stderr."""
    name = app.name[0]
    try:
        app(arguments, exit_on_error=False, error_console=Console(stderr=True), result_action="return_value")
    except CycloptsError:
        return 2
    except GtlayoutError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"{name}: interrupted; what is finished is kept, run it again to go on", file=sys.stderr)
        return 130
    return 0
