"""Key frames as Label Studio would export them, for tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from gtlayout.io.annotations.masks import simple_rings
from gtlayout.io.files import write_json_atomic
from gtlayout.scene import FloatArray, Frame, KeyFrame


def write_label_studio(path: Path, frames: Sequence[Frame], key_frames: Sequence[KeyFrame]) -> None:
    """Write ``key_frames`` (indices into ``frames``), drawn on the pinhole images, as a JSON export."""
    write_json_atomic(path, label_studio_json(frames, key_frames))


def label_studio_json(frames: Sequence[Frame], key_frames: Sequence[KeyFrame]) -> list[dict[str, Any]]:
    """A task for each key frame; elements and visible parts are polygons, tied by the texts ``id`` and ``element``."""
    return [_task(number, frames[key_frame.frame], key_frame) for number, key_frame in enumerate(key_frames, 1)]


def region(
    region_id: str, value: dict[str, Any], size: tuple[int, int], *, kind: str, label: str, **texts: str
) -> list[dict[str, Any]]:
    """The results of one region, as the editor makes them: each has a copy of the geometry."""
    common = {
        "original_width": size[0],
        "original_height": size[1],
        "image_rotation": 0,
        "id": region_id,
        "to_name": "image",
        "origin": "manual",
    }
    labelled = {**common, "value": {**value, kind: [label]}, "from_name": kind.removesuffix("labels"), "type": kind}
    said = [
        {**common, "value": {**value, "text": [text]}, "from_name": tag, "type": "textarea"}
        for tag, text in texts.items()
    ]
    return [labelled, *said]


def task(number: int, image: str, results: list[dict[str, Any]]) -> dict[str, Any]:
    """A task with one annotation."""
    times = {"created_at": "2025-03-09T22:16:08.728353Z", "updated_at": "2025-03-09T22:16:08.728378Z"}
    annotation = {"id": 1000 + number, "completed_by": 1, "result": results, "was_cancelled": False, **times}
    return {"id": number, "annotations": [annotation], "predictions": [], "data": {"image": image}, "project": 1}


def pack(values: list[tuple[bool, int, list[int]]], count: int, lengths: tuple[int, ...] = (3, 4, 8, 16)) -> bytes:
    """(one value repeats, which length, the values) → bytes as Label Studio packs them."""
    bits = f"{count:032b}{7:05b}" + "".join(f"{length - 1:04b}" for length in lengths)
    for repeated, which, run in values:
        bits += f"{repeated:b}{which:02b}{len(run) - 1:0{lengths[which]}b}"
        bits += "".join(f"{value:08b}" for value in (run[:1] if repeated else run))
    bits += "0" * (-len(bits) % 8)
    return bytes(int(bits[i : i + 8], 2) for i in range(0, len(bits), 8))


def _task(number: int, frame: Frame, key_frame: KeyFrame) -> dict[str, Any]:
    size = (frame.camera.width, frame.camera.height)
    drawn = [
        *((ring, e.label, {"id": e.id}) for e in key_frame.elements for ring in simple_rings(e.amodal)),
        *((ring, "visible", {"element": e.id}) for e in key_frame.elements for ring in simple_rings(e.visible)),
        *((ring, "blank", {}) for ring in simple_rings(key_frame.blank)),
    ]
    results = []
    for i, (ring, label, texts) in enumerate(drawn):
        value = {"points": _percent(ring, size), "closed": True}
        results += region(f"p{number}-{i}", value, size, kind="polygonlabels", label=label, **texts)
    for i, edge in enumerate(key_frame.occlusion_edges):
        vertices = [
            {"id": str(j), "prevPointId": str(j - 1) if j else None, "x": x, "y": y, "isBezier": False}
            for j, (x, y) in enumerate(_percent(edge, size))
        ]
        value = {"vertices": vertices, "closed": False}
        results += region(f"v{number}-{i}", value, size, kind="vectorlabels", label="occlusion_edge")
    return task(number, "/data/local-files/?d=" + quote(frame.name), results)


def _percent(points_px: FloatArray, size: tuple[int, int]) -> list[list[float]]:
    return (points_px / np.array(size) * 100).tolist()
