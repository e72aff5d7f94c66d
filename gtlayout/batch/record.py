"""The record of each scene of a run: one row, the same in ``record.json``, ``run.csv`` and ``run.parquet``."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import json_text, read_json, write_atomic
from gtlayout.quality.headline import Word

FORMAT = "gtlayout-record/2"
SCENES = "scenes"
"""Folder of a run that holds a folder of results for each scene, called like the scene."""
RECORD_FILE, SOLVE_LOG_FILE, THUMBNAIL_FILE = "record.json", "log.txt", "thumbnail.jpg"
"""In each of these folders. A scene is finished once its record is there."""
CSV_FILE, PARQUET_FILE, RUN_FILE = "run.csv", "run.parquet", "run.json"
"""In the folder of the run."""

Status = Literal["accepted", "not accepted", "failed"]
Failure = Literal["input", "bug", "timeout", "died", "memory", "worker"]
"""Why there is no layout: the scene cannot be solved as it is; an unexpected exception; not done in time; its
process died of a signal; it exceeded its memory; its worker was lost again and again.
"""
PASSING: tuple[Failure, ...] = ("timeout", "died", "memory", "worker")
"""Failures that may not occur again. All others are the same whenever the same scene is solved."""
_KINDS: dict[str, type | tuple[type, ...]] = {
    "int": int,
    "float": (int, float),
    "bool": bool,
    "dict[str, float]": dict,
    "dict[str, str]": dict,
}
"""Of Record's fields, as JSON has them; all others are text."""


@dataclass(frozen=True)
class Record:
    """One scene of a run. Numbers are None where they are not known: for failed scenes, and of depth without depth."""

    scene: str
    """Path of its folder below the root it was found in."""
    status: Status
    failure: Failure | None = None
    reason: str = ""
    """Why it failed or is not to be trusted, and which instances are not ok; empty when all is well."""
    headline: Word | None = None
    """What to do with it: use it as it is, look at it first, redraw or film it again; None for failed scenes."""
    headline_reason: str = ""
    """Why, the most important first; empty for failed scenes."""
    predicted: str | None = None
    """"trustworthy" or "doubtful": the verdict of the covariances."""
    iou: float | None = None
    openings_iou: float | None = None
    sigma_depth_share: float | None = None
    """Predicted σ of depth as a share of the depth."""
    depth_error_mean: float | None = None
    """ε on visible parts of key frames with depth, world unit."""
    depth_error_trimmed_mean: float | None = None
    """The same without the worst 1 % of pixels."""
    depth_error_median: float | None = None
    metric: bool | None = None
    """Whether the world unit is the metre."""
    frames: int | None = None
    key_frames: int | None = None
    instances: int | None = None
    weak: int | None = None
    unobservable: int | None = None
    worst_frame: str | None = None
    worst_frame_iou: float | None = None
    worst_element: str | None = None
    """As "wall_1 = e2 in 000010.jpg"."""
    worst_element_iou: float | None = None
    warnings: int | None = None
    """Number of things skipped or repaired. Their texts are in quality.json."""
    seconds: float | None = None
    """From reading the scene to its results on disk, of the attempt that counts."""
    stages_s: dict[str, float] = field(default_factory=dict)
    """Seconds of each stage of the solve; columns ``seconds_<stage>`` of the tables."""
    peak_memory_mib: float | None = None
    """Largest resident set seen of the process that solved it."""
    attempts: int = 1
    worker: str = ""
    """Machine that solved it."""
    finished: str = ""
    """UTC, ISO 8601."""
    source: str = ""
    """The scene's folder."""
    configuration: str = ""
    """Program and settings it was solved with."""
    fingerprint: str = ""
    """SHA-256 of inputs and configuration; empty when the inputs could not be read, or changed meanwhile."""
    stamp: str = ""
    """Like the fingerprint, with sizes and times instead of contents: while it does not change, no input is read."""
    files: dict[str, str] = field(default_factory=dict)
    """SHA-256 of each file beside the record; not in the tables."""


def scene_folder(run: Path, scene: str) -> Path:
    """Where the results of a scene go."""
    return run / SCENES / scene


def write_record(path: Path, record: Record) -> None:
    """Write record.json. Raises GtlayoutError when the disk does not take it."""
    write_atomic(path, record_text(record))


def record_text(record: Record) -> str:
    """The content of record.json."""
    return json_text({"format": FORMAT, **asdict(record)})


def read_record(path: Path) -> Record:
    """Read record.json. Raises GtlayoutError when it is absent or not a record."""
    data = read_json(path)
    if data.pop("format", None) != FORMAT:
        raise GtlayoutError(f"{path} is no record of a scene ({FORMAT})")
    return record_of(data, path)


def record_of(data: dict[str, Any], path: Path) -> Record:
    """A record out of JSON; ``path`` is for the message. Raises GtlayoutError when something in it is wrong."""
    known = {one.name: str(one.type) for one in fields(Record)}
    fine = (
        {"scene", "status"} <= set(data) <= set(known)
        and all(_fits(value, known[name]) for name, value in data.items())
        and data["status"] in get_args(Status)
        and data.get("failure") in (None, *get_args(Failure))
        and data.get("headline") in (None, *get_args(Word))
        and all(_fits(seconds, "float") for seconds in data.get("stages_s", {}).values())
    )
    if not fine:
        raise GtlayoutError(f"{path} is damaged; remove it and run the batch again")
    return Record(**data)


def _fits(value: object, declared: str) -> bool:
    if value is None:
        return declared.endswith(" | None")
    kind = _KINDS.get(declared.removesuffix(" | None"), str)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
