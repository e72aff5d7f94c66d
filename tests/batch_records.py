"""What tests of batch runs share: a record, and a folder that looks like a scene."""

from __future__ import annotations

from pathlib import Path

from gtlayout.batch.record import Record

SOLVED = Record(
    "a",
    "accepted",
    headline="trust",
    headline_reason="IoU 0.900",
    iou=0.9,
    seconds=2.0,
    stages_s={"tracking": 1.0, "mesh": 0.5},
    configuration="0.1.0+abc seed=0",
    fingerprint="f",
    stamp="s",
)


def scene_with(folder: Path, *files: str) -> Path:
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("{}")
    return folder
