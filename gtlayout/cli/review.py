"""The command ``review``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gtlayout.api import load
from gtlayout.cli.console import FROM_THE_FOLDER, SUSPICIOUS, Sources, progress_bars, stdout
from gtlayout.io.files import write_atomic
from gtlayout.method import solve
from gtlayout.results.review_file import review_text
from gtlayout.review.review import review as review_drawings


def review(
    scene_dir: Annotated[Path, Parameter(name="DIR")],
    /,
    *,
    json: Path | None = None,
    sources: Sources = FROM_THE_FOLDER,
) -> int:
    """Solve a scene, and list the drawings that are probably wrong: one line each, the worst first, then how many.

    Each drawing is compared with what all others predict in its image. A line names the frame, the element and what is
    wrong with it: another place, label, missing, overlap, edge, occlusion edge missing, shape, gap. Results are not
    written.

    Parameters
    ----------
    scene_dir
        The scene folder.
    json
        Write the findings to this file, too, with the number of the edge, and where it is and should be in the image.
    """
    scene = load(scene_dir, **vars(sources))
    with progress_bars() as progress:
        solution = solve(scene, observer=progress)
        progress.stage("review")
        findings = review_drawings(solution)
    if json is not None:
        write_atomic(json, review_text(findings))
    console = stdout()
    for finding in findings:
        console.print(f"{finding.kind}: {finding.line}", style="yellow")
    drawings = f"{len(scene.key_frames)} drawing{'s' if len(scene.key_frames) > 1 else ''}"
    counted = f"{len(findings)} finding{'s' if len(findings) > 1 else ''}" if findings else "nothing wrong"
    console.print(f"{counted} in {drawings}")
    return SUSPICIOUS if findings else 0
