"""What the command lines of all scripts share."""

from __future__ import annotations

import sys
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number

import gtlayout.cli.console

GTLAYOUT = (sys.executable, "-c", "import sys; from gtlayout.cli.app import main; sys.exit(main())")
"""What the command ``gtlayout`` is."""
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
    return gtlayout.cli.console.exit_status(
        app, arguments, "interrupted; what is finished is kept, run it again to go on"
    )
