"""From the folder of a run to its page: all reading and writing."""

from __future__ import annotations

from pathlib import Path

from gtlayout.batch.page.compare_runs import comparison
from gtlayout.batch.page.run_data import run_data
from gtlayout.batch.run_folder import read_run
from gtlayout.io.files import write_atomic
from gtlayout.report.page import environment


def write_run_report(run_dir: Path, out: Path, against: Path | None = None) -> None:
    """Write the page of a run to ``out``, compared with the run in ``against`` where one is given.

    Pictures and pages of the scenes are linked, relative to ``out``. The same bytes for the same records.

    Raises GtlayoutError when one of the two is no run, or the disk does not take the page.
    """
    run = read_run(run_dir)
    other = None if against is None else read_run(against)
    data = run_data(run, out.parent)
    compared = None if other is None else comparison(run, other, out.parent)
    write_atomic(out, environment("gtlayout.batch.page").get_template("run.html").render(data, against=compared))
