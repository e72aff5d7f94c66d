"""The command ``gtlayout propose``. Loaded only when it is called."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import Parameter

from gtlayout.api import load
from gtlayout.cli.console import (
    FROM_THE_FOLDER,
    AsJson,
    NewFolder,
    Positive,
    SceneDir,
    Sources,
    print_next,
    print_notes,
    print_warnings,
    progress_bars,
    stdout,
)
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import json_text
from gtlayout.io.pixels.images import read_bgr
from gtlayout.method import solve
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.files import Tool, write_proposals
from gtlayout.proposals.order import Order, next_frames
from gtlayout.proposals.proposal import Proposal
from gtlayout.proposals.propose import Proposer
from gtlayout.results.names import FOLDER
from gtlayout.scene import Frame, ImageArray, Scene


def propose(
    scene_dir: SceneDir,
    /,
    *,
    frames: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative=())] = (),
    next: Positive = 1,
    order: Order = "spread",
    to: Tool = "native",
    out: NewFolder | None = None,
    json: AsJson = False,
    sources: Sources = FROM_THE_FOLDER,
) -> None:
    """Propose the drawings of frames that are not drawn yet, to be corrected instead of drawn.

    The scene is solved from what is drawn. Polygons, visible parts and occlusion edges of other frames follow from
    the layout, with a score for each element. Native proposals become drafts in annotations.json, which count for
    nothing until a person confirms them. As JSON each edge has its σ and confidence, too.

    Parameters
    ----------
    scene_dir
        The scene folder.
    frames
        Images to propose, by name or by their number from 0 on.
    next
        Without --frames: so many frames, the most useful ones first.
    order
        Which frames these are: spread evenly, for the best geometry, or the next in the video, for the least work.
    to
        Drafts of gtlayout's own, in annotations.json (or drafts.json beside the results where another tool's file
        holds the drawings), CVAT's XML, or tasks with predictions for Label Studio.
    out
        Folder for all but drafts in annotations.json; DIR/gtlayout when not given.
    """
    scene = load(scene_dir, **vars(sources))
    chosen = [_frame_of(scene, name) for name in frames] or list(next_frames(scene, next, order))
    if not chosen:
        raise GtlayoutError(f"{scene_dir}: all {len(scene.frames)} frames are drawn, so there is none to propose")
    with progress_bars() as progress:
        solution = solve(scene, observer=progress)
        proposer, problems, proposals = Proposer(solution, ProposalConfig()), [], []
        progress.stage("proposals")
        for number, frame in enumerate(dict.fromkeys(chosen)):
            image, problem = _image(solution.scene.frames[frame])
            problems += [problem] if problem else []
            proposals.append(proposer.propose(frame, image))
            progress.progress(number + 1, len(chosen))
    path = write_proposals(
        scene_dir, out or scene_dir / FOLDER, sources.annotations, solution.scene.frames, proposals, to
    )
    console = stdout()
    if json:
        data = {
            "file": str(path),
            "frames": [_as_json(proposal, solution.scene) for proposal in proposals],
            "warnings": [*problems, *solution.scene.warnings],
            "notes": solution.scene.notes,
        }
        console.print(json_text(data), end="")
        return
    for proposal in proposals:
        console.print(_line(proposal, solution.scene))
    print_warnings(console, [*problems, *solution.scene.warnings], verbose=False)
    print_notes(console, solution.scene.notes)
    console.print(f"Proposals: {path}")
    if to == "native":
        print_next(console, "annotate", scene_dir)


def _frame_of(scene: Scene, name: str) -> int:
    """The frame of that name or number. Raises GtlayoutError when there is none, or it is drawn already."""
    found = [i for i, frame in enumerate(scene.frames) if name in (frame.name, str(i))]
    named = [i for i in found if scene.frames[i].name == name] or found
    if not named:
        raise GtlayoutError(f"no frame {name!r}; there are {len(scene.frames)}, the first is {scene.frames[0].name}")
    if named[0] in {key_frame.frame for key_frame in scene.key_frames}:
        raise GtlayoutError(
            f"frame {scene.frames[named[0]].name} is drawn already: remove it there to have it proposed"
        )
    return named[0]


def _image(frame: Frame) -> tuple[ImageArray | None, str]:
    """The pixels, or why there are none: the proposal is then not moved to lines of the image."""
    try:
        return read_bgr(frame), ""
    except GtlayoutError as error:
        return None, f"{error}: its proposal is not moved to lines of the image"


def _line(proposal: Proposal, scene: Scene) -> str:
    camera = scene.frames[proposal.frame].camera
    uncovered = proposal.uncovered.area / (camera.width * camera.height)
    scores = ", ".join(f"{proposed.element.id} {proposed.score:.2f}" for proposed in proposal.elements)
    return f"{scene.frames[proposal.frame].name}: {scores or 'nothing to propose'}; {uncovered:.0%} uncovered"


def _as_json(proposal: Proposal, scene: Scene) -> dict[str, Any]:
    return {
        "image": scene.frames[proposal.frame].name,
        "elements": [
            {
                "id": proposed.element.id,
                "label": proposed.element.label,
                "score": proposed.score,
                "edges": [
                    {
                        "start_px": edge.start_px,
                        "end_px": edge.end_px,
                        "kind": edge.kind,
                        "sigma_px": edge.sigma_px,
                        "confidence": edge.confidence,
                        "unsnapped_px": edge.unsnapped_px,
                    }
                    for edge in proposed.edges
                ],
            }
            for proposed in proposal.elements
        ],
        "uncovered_px2": proposal.uncovered.area,
    }
