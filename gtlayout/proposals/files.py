"""Proposals in the files of annotation tools."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from gtlayout.io.annotations import native
from gtlayout.io.annotations.cvat.writer import write_cvat
from gtlayout.io.annotations.drafts import on_shown_image
from gtlayout.io.annotations.label_studio.predictions import write_predictions
from gtlayout.io.archives import archive_of
from gtlayout.io.scene_folder import annotation_source
from gtlayout.proposals.proposal import Proposal
from gtlayout.scene import Frame

Tool = Literal["native", "cvat", "label-studio"]
FILE_NAMES: dict[Tool, str] = {
    "native": "drafts.json",
    "cvat": "proposals_cvat.xml",
    "label-studio": "proposals_label_studio.json",
}


def write_proposals(
    root: Path,
    results: Path,
    annotations: Path | None,
    frames: Sequence[Frame],
    proposals: Sequence[Proposal],
    tool: Tool,
) -> Path:
    """Write proposals for a tool, and say to which file.

    Native ones become drafts in the scene's own annotation file, where it has one that can be written: beside the
    drawings, and apart from them. Everything else goes to the folder ``results``.

    Args:
        root: The scene folder.
        results: Where gtlayout's files go.
        annotations: The file or folder that the scene's drawings were read from, where one was named.
        frames: Of the scene.
        proposals: One for each frame that is proposed.
        tool: Whose format.

    Raises GtlayoutError when the file cannot be written; it is then as it was.
    """
    drafts = [proposal.draft() for proposal in proposals]
    path = results / FILE_NAMES[tool]
    if tool == "label-studio":
        write_predictions(path, frames, drafts)
        return path
    if tool == "cvat":
        shown = list(frames)
        key_frames = []
        for draft in drafts:
            index = draft.key_frame.frame
            shown[index], on_image = on_shown_image(draft, frames[index])
            key_frames.append(on_image.key_frame)
        write_cvat(path, shown, key_frames, proposed=True)
        return path
    source = annotation_source(root, annotations)
    if source is not None and source.reader is native.READER and archive_of(source.path) is None:
        native.write_drafts(source.path, frames, drafts)
        return source.path
    native.write_draft_file(path, frames, drafts)
    return path
