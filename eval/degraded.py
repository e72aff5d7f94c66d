"""Scenes spoiled the way cameras and annotators spoil them: how much is wrong then, and of what nobody is warned."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from common.command_line import Jobs, exit_status, new_app
from variants import tables as variant_tables
from variants.degradations import kind_of

RESULTS = Path(__file__).with_name("results") / "degraded"

app = new_app("degraded", __doc__)


@app.default
def measure(*roots: Annotated[Path, Parameter(name="SCENE")], out: Path = RESULTS, jobs: Jobs = 1) -> None:
    """Solve scenes in every degradation with default settings; write tables and a plot.

    Scenes need gt_planes.json. Each solve is a process of its own. A run that was cut short goes on where it was.

    Parameters
    ----------
    roots
        Scene folders, or folders of scene folders.
    out
        Where tables, the plot and the results of each row go.
    jobs
        Solves at a time.
    """
    outcomes = variant_tables.run("degradations", roots, out, jobs, list)
    variant_tables.write(out, outcomes, kind_of)
    variant_tables.show(out, outcomes)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
