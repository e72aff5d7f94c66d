"""Tasks of Label Studio → predictions: the ``results`` of its ``/predict``."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.checked import name
from gtlayout.io.annotations.label_studio.control_tags import ControlTags
from gtlayout.io.annotations.label_studio.predictions import Json, nothing, prediction
from gtlayout.io.image_names import path_of_address
from gtlayout.serve.solved_room import SolvedRoom

LOG = logging.getLogger(__name__)


def predictions(tasks: Sequence[Any], tags: ControlTags, room: SolvedRoom) -> list[Json]:
    """A prediction for each task, in order; an empty one, and a line that says why, where there is nothing to propose.

    Raises GtlayoutError when a task is no task.
    """
    return [_prediction(task, tags, room) for task in tasks]


def _prediction(task: Any, tags: ControlTags, room: SolvedRoom) -> Json:
    image = _image(task, tags.draws["polygon"].image_key)
    found = room.find(image)
    if isinstance(found, str):
        LOG.warning("%s: nothing is proposed, it %s", image, found)
        return nothing(room.version)
    made, lacking = prediction(room.propose(found).draft(), found.view, tags, room.version)
    if lacking:
        LOG.warning("%s: label_config has nothing to draw %s with: not proposed", image, ", ".join(lacking))
    return made


def _image(task: Any, key: str) -> str:
    data = task.get("data") if isinstance(task, dict) else None
    if not isinstance(data, dict):
        raise GtlayoutError("a task has no data")
    url = data.get(key)
    image = name(path_of_address(url)) if isinstance(url, str) else None
    if image is None:
        raise GtlayoutError(f"a task has no image in its data's {key!r}")
    return image
