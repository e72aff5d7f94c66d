"""Drafts as Label Studio's predictions: tasks to import, each with regions and scores for the labeling interface."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from gtlayout.io.annotations.drafts import Draft, on_shown_image, percent
from gtlayout.io.annotations.masks import simple_rings
from gtlayout.io.files import write_json_atomic
from gtlayout.scene import Frame
from gtlayout.version import __version__

MODEL = f"gtlayout {__version__}"


def write_predictions(path: Path, frames: Sequence[Frame], drafts: Sequence[Draft]) -> None:
    """Write a task with one prediction for each draft. Raises GtlayoutError when the file cannot be written."""
    write_json_atomic(path, [prediction_task(frames[draft.key_frame.frame], draft) for draft in drafts])


def prediction_task(frame: Frame, draft: Draft) -> dict[str, Any]:
    """A task with one prediction, in pixels of the image as it is shown.

    Regions are those of gtlayout's labeling interface: polygons for elements and their visible parts, tied by the texts
    ``id`` and ``element``, and vectors for occlusion edges. The task's score is the mean of its elements'.
    """
    shown, on_image = on_shown_image(draft, frame)
    scores = list(draft.scores.values())
    return {
        "data": {"image": "/data/local-files/?d=" + quote(frame.name)},
        "predictions": [
            {
                "model_version": MODEL,
                "score": sum(scores) / len(scores) if scores else 0.0,
                "result": list(_results(on_image, (shown.camera.width, shown.camera.height))),
            }
        ],
    }


def _results(draft: Draft, size: tuple[int, int]) -> Iterator[dict[str, Any]]:
    for element in draft.key_frame.elements:
        score = draft.scores[element.id]
        for label, texts, region in (
            (element.label, ("id", element.id), element.amodal),
            ("visible", ("element", element.id), element.visible),
        ):
            for number, ring in enumerate(simple_rings(region)):
                common = _common(f"{element.id}-{label}-{number}", size)
                value = {"points": percent(ring, size), "closed": True}
                yield {
                    **common,
                    "from_name": "polygon",
                    "type": "polygonlabels",
                    "score": score,
                    "value": {**value, "polygonlabels": [label]},
                }
                name, text = texts
                yield {**common, "from_name": name, "type": "textarea", "value": {**value, "text": [text]}}
    for number, line in enumerate(draft.key_frame.occlusion_edges):
        vertices = [
            {"id": str(k), "prevPointId": str(k - 1) if k else None, "x": x, "y": y, "isBezier": False}
            for k, (x, y) in enumerate(percent(line, size))
        ]
        value = {"vertices": vertices, "closed": False, "vectorlabels": ["occlusion_edge"]}
        yield {
            **_common(f"occlusion_edge-{number}", size),
            "from_name": "vector",
            "type": "vectorlabels",
            "value": value,
        }


def _common(region_id: str, size: tuple[int, int]) -> dict[str, Any]:
    return {
        "id": region_id,
        "original_width": size[0],
        "original_height": size[1],
        "image_rotation": 0,
        "to_name": "image",
        "origin": "prediction",
    }
