"""The findings of a review as a file: review.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import json_text, read_json
from gtlayout.io.numbers import real, reals, whole
from gtlayout.results.names import REVIEW_FILE
from gtlayout.review.findings import KINDS, Finding
from gtlayout.scene import FloatArray, Scene

FORMAT = "gtlayout-review/1"
_KIND_OF = {str(kind): kind for kind in KINDS}


def review_text(findings: Sequence[Finding]) -> str:
    """The text of the file: the findings in their order, pixels to two decimals."""
    rows = [{field.name: _plain(getattr(one, field.name)) for field in fields(one)} for one in findings]
    return json_text({"format": FORMAT, "findings": rows})


def read_review(folder: Path, scene: Scene) -> tuple[Finding, ...] | None:
    """The findings in a folder of results; None when the drawings were not reviewed.

    Raises GtlayoutError when the file is damaged, or of a scene with other key frames.
    """
    path = folder / REVIEW_FILE
    if not path.exists():
        return None
    data = read_json(path)
    if data.get("format") != FORMAT:
        raise GtlayoutError(f'{path} is not a review: its "format" is {data.get("format")!r}, not {FORMAT!r}')
    try:
        found = tuple(_read(row) for row in data["findings"])
    except (KeyError, TypeError, ValueError) as error:
        raise GtlayoutError(f"{path} is damaged: {type(error).__name__} {error}; solve the scene again") from error
    for one in found:
        if not 0 <= one.key_frame < len(scene.key_frames) or scene.frame_of(one.key_frame).name != one.frame_name:
            raise GtlayoutError(f"{path} is of other annotations ({one.frame_name}): solve the scene again")
    return found


def _read(row: dict[str, Any]) -> Finding:
    return Finding(
        key_frame=whole(row["key_frame"]),
        frame_name=str(row["frame_name"]),
        element_id=None if row["element_id"] is None else str(row["element_id"]),
        edge=None if row["edge"] is None else whole(row["edge"]),
        kind=_KIND_OF[row["kind"]],
        message=str(row["message"]),
        severity=real(row["severity"]),
        where_px=_points(row["where_px"]),
        expected_px=None if row["expected_px"] is None else _points(row["expected_px"]),
    )


def _points(values: Any) -> FloatArray:
    return reals(values, (-1, 2))


def _plain(value: Any) -> Any:
    """As JSON has it; rounded, so that the last bits of a processor do not show."""
    if isinstance(value, np.ndarray):
        return value.round(2)
    return round(value, 4) if isinstance(value, float) else value
