"""Tasks of Label Studio → predictions: the ``results`` of its ``/predict``.

The fields of a region are those of Label Studio's documentation, "Import pre-annotated data", and of its editor's
``Result.serialize``: coordinates are percent of the image as it is shown, and each result repeats the geometry.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.checked import name
from gtlayout.io.image_names import path_of_address
from gtlayout.scene import FloatArray
from gtlayout.serve.control_tags import ControlTag, ControlTags
from gtlayout.serve.shapes import ToolShape, score_of, tool_shapes
from gtlayout.serve.solved_room import SolvedRoom

LOG = logging.getLogger(__name__)
Json = dict[str, Any]


def predictions(tasks: Sequence[Any], tags: ControlTags, room: SolvedRoom) -> list[Json]:
    """A prediction for each task, in order; an empty one, and a line that says why, where there is nothing to propose.

    Raises GtlayoutError when a task is no task.
    """
    return [_prediction(task, tags, room) for task in tasks]


def nothing(version: str) -> Json:
    """The prediction for a task of which nothing is known. Label Studio wants one for each."""
    return {"model_version": version, "score": 0.0, "result": []}


def _prediction(task: Any, tags: ControlTags, room: SolvedRoom) -> Json:
    image = _image(task, tags.draws["polygon"].image_key)
    found = room.find(image)
    if isinstance(found, str):
        LOG.warning("%s: nothing is proposed, it %s", image, found)
        return nothing(room.version)
    proposal = room.propose(found)
    shapes = tool_shapes(proposal, found.view)
    results = [each for shape in shapes for each in _results(shape, tags, found.view.annotated_size)]
    if lacking := sorted({shape.label for shape in shapes if _tag(shape, tags) is None}):
        LOG.warning("%s: label_config has nothing to draw %s with: not proposed", image, ", ".join(lacking))
    return {"model_version": room.version, "score": score_of(proposal), "result": results}


def _image(task: Any, key: str) -> str:
    data = task.get("data") if isinstance(task, dict) else None
    if not isinstance(data, dict):
        raise GtlayoutError("a task has no data")
    url = data.get(key)
    image = name(path_of_address(url)) if isinstance(url, str) else None
    if image is None:
        raise GtlayoutError(f"a task has no image in its data's {key!r}")
    return image


def _tag(shape: ToolShape, tags: ControlTags) -> ControlTag | None:
    tag = tags.draws.get(shape.kind)
    return tag if tag is not None and shape.label in tag.labels else None


def _results(shape: ToolShape, tags: ControlTags, size: tuple[int, int]) -> Iterator[Json]:
    tag = _tag(shape, tags)
    if tag is None:
        return
    labels_key, value = _value(shape, size)
    common = {"id": shape.name, "original_width": size[0], "original_height": size[1], "image_rotation": 0}
    yield {
        **common,
        "from_name": tag.name,
        "to_name": tag.to_name,
        "type": labels_key,
        "value": {**value, labels_key: [tag.labels[shape.label]]},
        "score": shape.score,
    }
    if shape.text is not None and tags.texts.get(shape.text[0]) == tag.to_name:
        field, text = shape.text
        about: Mapping[str, Any] = {"from_name": field, "to_name": tag.to_name, "type": "textarea"}
        yield {**common, **about, "value": {**value, "text": [text]}}


def _value(shape: ToolShape, size: tuple[int, int]) -> tuple[str, Json]:
    """The key of its labels, and its geometry."""
    points = _percent(shape.points_px, size)
    if shape.kind == "polygon":
        return "polygonlabels", {"points": points, "closed": True}
    vertices = [
        {"id": f"{shape.name}-{i}", "prevPointId": f"{shape.name}-{i - 1}" if i else None, "x": x, "y": y}
        for i, (x, y) in enumerate(points)
    ]
    return "vectorlabels", {"vertices": [{**vertex, "isBezier": False} for vertex in vertices], "closed": False}


def _percent(points_px: FloatArray, size: tuple[int, int]) -> list[list[float]]:
    percent: list[list[float]] = (points_px / np.array(size) * 100).tolist()
    return percent
