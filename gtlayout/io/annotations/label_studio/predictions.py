"""Drafts as Label Studio's predictions, for whatever labeling configuration.

The fields of a region are those of Label Studio's documentation, "Import pre-annotated data", and of its editor's
``Result.serialize``: coordinates are percent of the image as it is shown, and each result repeats the geometry.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from gtlayout.io.annotations.drafts import Draft
from gtlayout.io.annotations.label_studio.control_tags import ControlTag, ControlTags, control_tags
from gtlayout.io.annotations.labeling import label_config
from gtlayout.io.annotations.labels import Kind, label_meanings
from gtlayout.io.annotations.outlines import View
from gtlayout.io.annotations.tool_shapes import ToolShape, tool_shapes
from gtlayout.io.files import write_json_atomic
from gtlayout.scene import FloatArray, Frame
from gtlayout.version import __version__

Json = dict[str, Any]
MODEL = f"gtlayout {__version__}"


def write_predictions(path: Path, frames: Sequence[Frame], drafts: Sequence[Draft]) -> None:
    """Write a task with one prediction for each draft. Raises GtlayoutError when the file cannot be written."""
    write_json_atomic(path, [prediction_task(frames[draft.key_frame.frame], draft) for draft in drafts])


def prediction_task(frame: Frame, draft: Draft) -> Json:
    """A task with one prediction, for gtlayout's own labeling configuration."""
    tags = control_tags(label_config("label-studio"), label_meanings({}))
    made, _ = prediction(draft, View.of(frame.name, frame, None), tags, MODEL)
    key = tags.draws["polygon"].image_key
    return {"data": {key: "/data/local-files/?d=" + quote(frame.name)}, "predictions": [made]}


def prediction(draft: Draft, view: View, tags: ControlTags, version: str) -> tuple[Json, tuple[Kind, ...]]:
    """What Label Studio shows in an image, and what of it the configuration has no tag for: that is left out."""
    shapes = tool_shapes(draft, view)
    results = [each for shape in shapes for each in _results(shape, tags, view.annotated_size)]
    lacking = sorted({shape.label for shape in shapes if _tag(shape, tags) is None})
    return {"model_version": version, "score": draft.score, "result": results}, tuple(lacking)


def nothing(version: str) -> Json:
    """The prediction for a task of which nothing is known. Label Studio wants one for each."""
    return {"model_version": version, "score": 0.0, "result": []}


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
        about = {"from_name": field, "to_name": tag.to_name, "type": "textarea"}
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
