"""The content of a run's page: plain data from its records. Names and reasons come from files and are only text."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, get_args
from urllib.parse import quote

import numpy as np

from gtlayout.batch.page.histogram import histogram
from gtlayout.batch.record import SOLVE_LOG_FILE, THUMBNAIL_FILE, Failure, Record, scene_folder
from gtlayout.batch.run_folder import Run
from gtlayout.io.files import printable
from gtlayout.quality.config import QualityConfig
from gtlayout.report.plain import finite
from gtlayout.results.names import REPORT_FILE

FAILURES: dict[Failure, str] = {
    "input": "cannot be solved as they are: send back, or repair the files",
    "bug": "an unexpected exception: report it with the log",
    "timeout": "not done in time; the next run tries again",
    "died": "the process died of a signal; the next run tries again",
    "memory": "took more memory than there was; the next run tries again",
    "worker": "the worker was lost again and again; the next run tries again",
}
"""In the order of importance."""
Group = Literal["failed", "redo", "check", "trust"]
GROUPS: tuple[Group, ...] = get_args(Group)
"""Groups of scenes, the worst first: those without a layout, and the others by headline."""


def run_data(run: Run, page_dir: Path) -> dict[str, Any]:
    """Everything the template needs of one run; links are relative to ``page_dir``, where the page will lie."""
    records = sorted(run.records.values(), key=_worst_first)
    groups = Counter(group(record) for record in records)
    status = Counter(record.status for record in records)
    rows = [row(record, run.folder, page_dir) for record in records]
    seconds = [value for record in records if (value := number(record.seconds)) is not None]
    memory = [value for record in records if (value := number(record.peak_memory_mib)) is not None]
    return {
        "title": printable(run.folder.resolve().name),
        "version": printable(run.version),
        "scenes": len(run.scenes),
        "finished": len(records),
        "not_yet": [printable(name) for name in run.scenes if name not in run.records],
        "status": {name: status[name] for name in ("accepted", "not accepted", "failed")},
        "groups": {name: groups[name] for name in GROUPS},
        "accept_share": status["accepted"] / len(records) if records else None,
        "accept_iou": accept_iou(run),
        "seconds": sum(seconds),
        "scenes_per_hour": 3600 * len(seconds) / sum(seconds) if sum(seconds) > 0 else None,
        "peak_memory_mib": max(memory, default=None),
        "last": max((record.finished for record in records), default=""),
        "failures": _failures(records),
        "crossed": {
            verdict: {
                word: sum(record.status == verdict and record.predicted == word for record in records)
                for word in ("trustworthy", "doubtful")
            }
            for verdict in ("accepted", "not accepted")
        },
        "distributions": _distributions(records, accept_iou(run)),
        "files": {"page": REPORT_FILE, "log": SOLVE_LOG_FILE, "thumbnail": THUMBNAIL_FILE},
        "table": {
            "keys": list(rows[0]) if rows else [],
            "rows": [list(one.values()) for one in rows],
        },
        "send_back": [
            f"{printable(record.scene)}\t{_why_back(record)}"
            for record in records
            if record.failure == "input" or group(record) == "redo"
        ],
    }


def row(record: Record, run: Path, page_dir: Path) -> dict[str, Any]:
    """A scene as a row of the table: plain values, numbers with six digits, None where not known."""
    weak, unobservable = number(record.weak), number(record.unobservable)
    return {
        "name": printable(record.scene),
        "folder": link(scene_folder(run, record.scene), page_dir),
        "group": group(record),
        "verdict": group(record) + (f": {record.failure}" if record.failure else ""),
        "status": _status(record),
        "iou": _short(record.iou),
        "sigma": _short(record.sigma_depth_share),
        "depth_error": _short(record.depth_error_median),
        "unit": "m" if record.metric else "u",
        "weak": None if weak is None else weak + (unobservable or 0),
        "instances": number(record.instances),
        "redraw": printable(record.worst_element or ""),
        "redraw_iou": _short(record.worst_element_iou),
        "reason": reason(record),
        "seconds": _short(record.seconds),
        "memory": _short(record.peak_memory_mib),
    }


def group(record: Record) -> Group:
    """Which pile a scene belongs to. Records of earlier versions have no headline: they go by the two measures."""
    if record.status == "failed":
        return "failed"
    if record.headline is not None:
        return record.headline
    if record.status == "not accepted":
        return "redo"
    return "check" if record.predicted == "doubtful" else "trust"


def _status(record: Record) -> str:
    """The verdicts of IoU and covariances as text; empty for failed scenes."""
    if record.status == "failed":
        return ""
    return record.status + (", doubtful" if record.predicted == "doubtful" else "")


def reason(record: Record) -> str:
    """Why, without the scene's own folder in front of its files."""
    reason = record.reason
    if record.source:
        reason = reason.replace(f"{record.source}{os.sep}", "").replace(record.source, "the scene's folder")
    return printable(reason)


def number(value: float | None) -> float | None:
    """A number of a record; None where it is not known, or not finite."""
    return None if value is None else finite(value)


def link(path: Path, page_dir: Path) -> str:
    """Relative address of a file, percent-encoded: a name with : ? # or % in it stays a name."""
    relative = Path(os.path.relpath(path.resolve(), page_dir.resolve())).as_posix()
    return quote(relative.encode("utf-8", "surrogateescape"), safe="/")


def accept_iou(run: Run) -> float:
    """The IoU from which on this run accepted a scene."""
    quality = run.config.get("quality")
    found = quality.get("accept_iou") if isinstance(quality, dict) else None
    return found if isinstance(found, float) else QualityConfig().accept_iou


def median(values: Sequence[float]) -> float | None:
    """None of nothing."""
    return float(np.median(values)) if values else None


def _worst_first(record: Record) -> tuple[int, int, float, str]:
    kinds = list(FAILURES)
    kind = kinds.index(record.failure) if record.failure in kinds else len(kinds)
    iou = number(record.iou)
    return GROUPS.index(group(record)), kind, 0.0 if iou is None else iou, record.scene


def _failures(records: Sequence[Record]) -> list[dict[str, Any]]:
    counts = Counter(record.failure for record in records if record.status == "failed")
    return [{"kind": kind, "count": counts[kind], "means": FAILURES[kind]} for kind in FAILURES if counts[kind]]


def _why_back(record: Record) -> str:
    return printable(record.headline_reason) or reason(record)


def _short(value: float | None) -> float | None:
    known = number(value)
    return None if known is None else float(f"{known:.6g}")


def _distributions(records: Sequence[Record], accepted_from: float) -> list[dict[str, Any]]:
    """One histogram per measure that is known for any scene."""

    def known(name: str, factor: float = 1.0) -> list[float]:
        found = (number(getattr(record, name)) for record in records)
        return [factor * value for value in found if value is not None]

    metric = [record for record in records if record.metric is True]
    depth = [100 * value for record in metric if (value := number(record.depth_error_median)) is not None]
    iou = known("iou")
    drawn = [
        ("reprojection IoU", "", 3, histogram(iou, min(iou, default=0.0), 1.0, accepted_from)),
        ("predicted σ of depth", " %", 1, histogram(known("sigma_depth_share", 100))),
        ("depth error ε (median; metric scenes)", " cm", 1, histogram(depth)),
        ("time to solve", " s", 1, histogram(known("seconds"))),
        ("peak memory", " MiB", 0, histogram(known("peak_memory_mib"))),
    ]
    return [
        {"title": title, "unit": unit, "digits": digits, "histogram": bars}
        for title, unit, digits, bars in drawn
        if bars is not None
    ]
