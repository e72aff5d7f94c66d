"""The fault table: breaks small scenes in every way, and compares what the user sees with what is promised."""

from __future__ import annotations

import json
import sys
import tempfile
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from common.command_line import exit_status, new_app
from faulty.case import Case, Room
from faulty.folders import make_room
from faulty.run import CannotRunError, Judged, judge
from faulty.table import ALL, page
from gtlayout.cli.console import stdout
from gtlayout.io.files import write_atomic

PAGE = Path(__file__).parents[1] / "docs/pages/faults.md"

app = new_app("faults", __doc__)


@app.default
def faults(
    *,
    only: str = "",
    out: Path | None = None,
    write_page: Annotated[bool, Parameter(name="--page", negative=())] = False,
) -> int:
    """Run all cases, and print those whose promises do not hold, and how many do.

    Exits with 3 when one does not hold.

    Parameters
    ----------
    only
        Cases with these words in their name.
    out
        A file to write what was seen of each case to, JSON.
    write_page
        Write the page of the documentation, and run nothing.
    """
    console = stdout()
    if write_page:
        write_atomic(PAGE, page())
        return 0
    seen: dict[str, object] = {}
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:

        @cache
        def room(kind: Room) -> Path:
            return make_room(kind, Path(folder) / kind)

        for number, case in enumerate(case for case in ALL if only in case.name):
            try:
                judged = judge(case, room(case.room), Path(folder) / str(number))
            except CannotRunError as error:
                counts["not run"] += 1
                console.print(f"{case.name}: not run, {error}")
                continue
            counts["broken" if judged.broken else "hold"] += 1
            seen[case.name] = _record(case, judged)
            for line in judged.broken:
                console.print(f"{case.name}: {line}", style="yellow")
    if out is not None:
        write_atomic(out, json.dumps(seen, indent=1, ensure_ascii=False) + "\n")
    console.print(f"{counts['hold']} of {counts['hold'] + counts['broken']} cases hold, {counts['not run']} not run")
    return 3 if counts["broken"] else 0


def _record(case: Case, judged: Judged) -> dict[str, object]:
    return {
        "command": case.command,
        "promised": {"status": case.status, "says": case.says},
        "status": judged.seen.status,
        "seen": judged.seen.text.splitlines()[:20],
        "broken": judged.broken,
    }


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
