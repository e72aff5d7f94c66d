"""The ScanNet columns of the paper's Table 1: depth error on visible parts, IoU, share accepted."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from common.command_line import Jobs, exit_status, new_app
from common.table1 import OURS, annotated_scenes, measure_ours, score_scenes, summary_row, write_summary

app = new_app("scannet_depth", __doc__)


@app.default
def run(root: Annotated[Path, Parameter(name="ROOT")], /, *, out: Path, jobs: Jobs = 1) -> None:
    """Solve every scene with default settings and compare the layouts with measured depth.

    Scenes may be exports of ScanNet, folders as in 7-Scenes and 3DMatch, or gtlayout's own, with annotations. A run
    that was cut short goes on where it was. Written are scenes.* and summary.* (.md, .csv, .json).

    Parameters
    ----------
    root
        A scene folder, or a folder of scene folders.
    out
        Where tables and the results of each scene go.
    jobs
        Scenes at a time.
    """
    scenes = annotated_scenes(root)
    scores = score_scenes(scenes, out, OURS, measure_ours, jobs)
    write_summary(out, scores, {OURS: summary_row(scores, len(scenes))})


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
