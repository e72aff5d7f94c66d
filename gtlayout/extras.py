"""Packages that only some of what gtlayout does needs: imported when asked for, one line where they are missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gtlayout.errors import GtlayoutError


class MissingExtraError(GtlayoutError):
    """What was asked for needs a package that is not installed. The command line exits with 2."""


@contextmanager
def needs(extra: str, what: str = "this") -> Iterator[None]:
    """Import within this block what ``gtlayout[extra]`` installs.

    Raises MissingExtraError, which says that ``what`` needs the package and how to install it, where it is missing.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package == "gtlayout":
            raise
        raise MissingExtraError(
            f"{what} needs {package}, which is not installed: pip install 'gtlayout[{extra}]'"
        ) from error
