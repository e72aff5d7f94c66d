"""Real clips in every form in which people have them: the table that changes of the method are judged by."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from common.command_line import Jobs, exit_status, new_app
from gtlayout.errors import GtlayoutError
from variants import tables as variant_tables

RESULTS = Path(__file__).with_name("results") / "real-clips"

app = new_app("real_clips", __doc__)


@app.default
def measure(
    *roots: Annotated[Path, Parameter(name="SCENE")],
    out: Path = RESULTS,
    form: Annotated[tuple[str, ...], Parameter(consume_multiple=True)] = (),
    jobs: Jobs = 1,
) -> None:
    """Solve clips in every form with default settings; write tables and a plot.

    Scenes need gt_planes.json. Each solve is a process of its own. A run that was cut short goes on where it was.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where tables, the plot and the results of each row go.
    form
        Only these forms, each by its name in the table.
    jobs
        Solves at a time.
    """

    def chosen(names: Sequence[str]) -> Sequence[str]:
        unknown = [name for name in form if name not in names]
        if unknown:
            raise GtlayoutError(f"no form {unknown[0]!r}; there are: {', '.join(names)}")
        return [name for name in names if not form or name in form]

    outcomes = variant_tables.run("forms", roots, out, jobs, chosen)
    variant_tables.write(out, outcomes, str)
    variant_tables.show(out, outcomes)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
