"""CVAT's auto-annotation function: ``cvat-cli task auto-annotate ID --function-module gtlayout.serve.cvat``.

Needs ``pip install 'gtlayout[cvat]'``. The interface is that of ``cvat_sdk.auto_annotation``: ``create`` makes the
function from the parameters that stand behind ``-p``, ``detect`` is called for each image of the task.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import cvat_sdk.auto_annotation as cvataa
from cvat_sdk.attributes import attribute_vals_from_dict
from tqdm.contrib.logging import logging_redirect_tqdm

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.cvat.reader import PROPOSED
from gtlayout.io.annotations.labeling import label_config
from gtlayout.io.annotations.tool_shapes import ToolShape, tool_shapes
from gtlayout.proposals.order import next_frames
from gtlayout.serve.solved_room import SolvedRoom
from gtlayout.serve.solving import solve_folder

LOG = logging.getLogger(__name__)
TYPES = {"occlusion_edge": "polyline", PROPOSED: "tag"}
"""What is drawn of a label; polygons of all others."""


def create(scene: str, cameras: str = "", annotations: str = "", next: int = 0) -> LayoutFunction:
    """Solve the scene folder ``scene``, and make the function that proposes drawings for its frames.

    ``cameras`` and ``annotations`` are those of ``gtlayout.load``; empty where the folder has only one of each. With
    ``next`` only the next so many frames that are worth drawing are proposed, else all that are not drawn. Raises
    GtlayoutError when the scene cannot be read or solved, or nothing is drawn in it yet.
    """
    cameras_path, annotations_path = (Path(given) if given else None for given in (cameras, annotations))
    LOG.warning("solving %s", scene)
    room = solve_folder(Path(scene), cameras_path, annotations_path)
    if room is None:
        raise GtlayoutError(
            f"{scene}: nothing is drawn in it yet, so nothing can be proposed: draw the first two frames in CVAT, "
            "export them as 'CVAT for images 1.1' to the scene folder, and run this again"
        )
    LOG.warning("proposing from %s", room.version)
    if not next:
        return LayoutFunction(room)
    chosen = next_frames(room.scene, next)
    LOG.warning("proposing only %s", ", ".join(room.scene.frames[frame].name for frame in chosen))
    return LayoutFunction(room, frozenset(chosen))


class LayoutFunction:
    """A detection function: looks frames up in a solved scene, and never at what the image shows alone."""

    def __init__(self, room: SolvedRoom, only: Collection[int] | None = None) -> None:
        """``only`` are the frames to propose; all when None."""
        self._room, self._only = room, only
        labels = json.loads(label_config("cvat"))
        self._label_ids = {label["name"]: i for i, label in enumerate(labels)}
        # Of the attributes those that are proposed: whether a wall is curved a person ticks.
        self._attribute_ids = {
            label["name"]: {
                each["name"]: i for i, each in enumerate(label["attributes"]) if each["input_type"] == "text"
            }
            for label in labels
        }
        self.spec = cvataa.DetectionFunctionSpec(labels=[self._label_spec(label["name"]) for label in labels])

    def detect(self, context: cvataa.DetectionFunctionContext, image: Any) -> Sequence[cvataa.DetectionAnnotation]:
        """Polygons, polylines and the tag that says they are proposed, for an image that Pillow has read.

        Nothing, and a line that says why, where the scene has no such frame, or it is drawn already.
        """
        # On lines of their own, not within that of cvat-cli's progress bar.
        with logging_redirect_tqdm([logging.getLogger("gtlayout")]):
            return self._detect(context, image.size)

    def _detect(
        self, context: cvataa.DetectionFunctionContext, size: tuple[int, int]
    ) -> Sequence[cvataa.DetectionAnnotation]:
        found = self._room.find(context.frame_name, size)
        if isinstance(found, str):
            LOG.warning("%s: nothing is proposed, it %s", context.frame_name, found)
            return []
        if self._only is not None and found.frame not in self._only:
            return []
        if found.is_drawn:
            LOG.warning("%s: nothing is proposed, it is drawn already", context.frame_name)
            return []
        shapes = tool_shapes(self._room.propose(found).draft(), found.view)
        kept = [shape for shape in shapes if shape.score >= (context.conf_threshold or 0.0)]
        if not kept:
            LOG.warning(
                "%s: nothing is proposed, no surface that is known and sure enough is there", context.frame_name
            )
            return []
        return [cvataa.tag(self._label_ids[PROPOSED]), *map(self._shape, kept)]

    def _label_spec(self, name: str) -> Any:
        attributes = [cvataa.text_attribute_spec(each, i) for each, i in self._attribute_ids[name].items()]
        return cvataa.label_spec(name, self._label_ids[name], type=TYPES.get(name, "polygon"), attributes=attributes)

    def _shape(self, shape: ToolShape) -> Any:
        texts: Mapping[str, str] = dict([shape.text]) if shape.text else {}
        ids = self._attribute_ids[shape.label]
        return cvataa.shape(
            self._label_ids[shape.label],
            type=shape.kind,
            # To 0.01 px, as CVAT itself writes them.
            points=shape.points_px.round(2).ravel().tolist(),
            score=shape.score,
            attributes=attribute_vals_from_dict({ids[name]: text for name, text in texts.items()}),
        )
