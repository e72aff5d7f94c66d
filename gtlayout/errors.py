"""The exception that gtlayout raises for problems that a user can understand and repair."""

import traceback
from pathlib import Path

MAX_CHARACTERS = 1000
"""Messages quote the content of files, which may be long."""


class GtlayoutError(Exception):
    """A known problem. The message says what is wrong, where (file, frame or element), and what to do.

    The command line prints it as one line and exits with 1. Any other exception is a bug and shows its traceback.
    """

    def __init__(self, message: str) -> None:
        # Names come from files: a line break in one must not become one here, half a character must be printable.
        line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in message)
        half = MAX_CHARACTERS // 2
        super().__init__(line if len(line) <= MAX_CHARACTERS else f"{line[:half]} … {line[-half:]}")


def one_line(error: BaseException) -> str:
    """The message of an unexpected exception, and where it came from."""
    at = traceback.extract_tb(error.__traceback__)[-1]
    return " ".join(f"{type(error).__name__}: {error} ({Path(at.filename).name}:{at.lineno})".split())
