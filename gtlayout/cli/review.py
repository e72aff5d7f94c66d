"""The command ``review``."""

from __future__ import annotations

from gtlayout.api import load
from gtlayout.cli.console import FROM_THE_FOLDER, SUSPICIOUS, AsJson, SceneDir, Sources, progress_bars, stdout
from gtlayout.method import solve
from gtlayout.results.review_file import review_text
from gtlayout.review.review import review as review_drawings


def review(
    scene_dir: SceneDir,
    /,
    *,
    json: AsJson = False,
    sources: Sources = FROM_THE_FOLDER,
) -> int:
    """Solve a scene, and list the drawings that are probably wrong: one line each, the worst first, then how many.

    Each drawing is compared with what all others predict in its image. A line names the frame, the element and what is
    wrong with it: another place, label, missing, overlap, edge, occlusion edge missing, shape, gap. Results are not
    written. As JSON each has the number of the edge, too, and where it is and should be in the image.

    Parameters
    ----------
    scene_dir
        The scene folder.
    """
    scene = load(scene_dir, **vars(sources))
    with progress_bars() as progress:
        solution = solve(scene, observer=progress)
        progress.stage("review")
        findings = review_drawings(solution)
    console = stdout()
    if json:
        console.print(review_text(findings), end="")
        return SUSPICIOUS if findings else 0
    for finding in findings:
        console.print(f"{finding.kind}: {finding.line}", style="yellow")
    drawings = f"{len(scene.key_frames)} drawing{'s' if len(scene.key_frames) > 1 else ''}"
    counted = f"{len(findings)} finding{'s' if len(findings) > 1 else ''}" if findings else "nothing wrong"
    console.print(f"{counted} in {drawings}")
    return SUSPICIOUS if findings else 0
