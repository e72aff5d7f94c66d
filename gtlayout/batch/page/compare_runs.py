"""Two runs of the same scenes: which are better, which are worse, and which settings differ."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gtlayout.batch.page.run_data import GROUPS, group, median, number, row
from gtlayout.batch.record import Record, Status
from gtlayout.batch.run_folder import Run
from gtlayout.io.files import printable
from gtlayout.report.data import flat

SHOWN = 300
"""Most scenes listed of those that are better, and of those that are worse."""
LEAST_IOU = 0.001
"""Smaller changes of the IoU do not count."""
_STATUSES: tuple[Status, ...] = ("failed", "not accepted", "accepted")
"""The worst first."""
_MEASURES = (
    ("reprojection IoU", "iou", 1.0, 4, "", +1),
    ("predicted σ of depth", "sigma_depth_share", 100.0, 2, " %", -1),
    ("depth error ε (of the median pixel; metric scenes)", "depth_error_median", 100.0, 2, " cm", -1),
    ("time to solve", "seconds", 1.0, 2, " s", -1),
    ("peak memory", "peak_memory_mib", 1.0, 0, " MiB", -1),
)
"""Title, field, factor to the unit, digits, unit, and which way is better."""


def comparison(run: Run, other: Run, page_dir: Path) -> dict[str, Any]:
    """The data for the template on ``run`` against ``other``. Scenes are matched by name."""
    both = [name for name in run.records if name in other.records]
    changes = [_change(run.records[name], other.records[name], run, other, page_dir) for name in both]
    worse = sorted((one for one in changes if one["order"] < (0, 0.0, 0.0)), key=lambda one: one["order"])
    better = sorted(
        (one for one in changes if one["order"] > (0, 0.0, 0.0)), key=lambda one: one["order"], reverse=True
    )
    return {
        "title": printable(other.folder.resolve().name),
        "version": printable(other.version),
        "both": len(both),
        "same": len(changes) - len(worse) - len(better),
        "worse": worse[:SHOWN],
        "worse_count": len(worse),
        "better": better[:SHOWN],
        "better_count": len(better),
        "status": [
            {
                "name": verdict,
                "here": sum(verdict in (group(run.records[name]), run.records[name].status) for name in both),
                "there": sum(verdict in (group(other.records[name]), other.records[name].status) for name in both),
            }
            for verdict in (*GROUPS[::-1], "accepted", "not accepted")
        ],
        "medians": _medians([(run.records[name], other.records[name]) for name in both]),
        "only_here": [printable(name) for name in run.records if name not in other.records],
        "only_there": [printable(name) for name in other.records if name not in run.records],
        "settings": _settings(run, other),
    }


def _change(here: Record, there: Record, run: Run, other: Run, page_dir: Path) -> dict[str, Any]:
    """A scene in both. ``order`` is below zero where it is worse: by its headline, then its IoU, then its ε."""
    iou = _difference(here.iou, there.iou)
    depth = _difference(here.depth_error_median, there.depth_error_median)
    ranks = _ranks(here, there)
    moved = iou if iou is not None and abs(iou) >= LEAST_IOU else 0.0
    return {
        "order": (ranks, moved, 0.0 if depth is None or iou is None or moved else -_far(depth, there)),
        "here": row(here, run.folder, page_dir),
        "there": row(there, other.folder, page_dir),
        "iou": iou,
        "depth_error": depth,
    }


def _ranks(here: Record, there: Record) -> int:
    """Above zero where the first is better: by their headlines, or by their status where one has no headline."""
    if all(record.headline is not None or record.status == "failed" for record in (here, there)):
        return GROUPS.index(group(here)) - GROUPS.index(group(there))
    return _STATUSES.index(here.status) - _STATUSES.index(there.status)


def _far(depth: float, there: Record) -> float:
    """A change of ε, 0 where it is less than a hundredth of it."""
    before = number(there.depth_error_median) or 0.0
    return depth if abs(depth) >= 0.01 * before else 0.0


def _difference(here: float | None, there: float | None) -> float | None:
    first, second = number(here), number(there)
    return None if first is None or second is None else first - second


def _medians(pairs: Sequence[tuple[Record, Record]]) -> list[dict[str, Any]]:
    """Of the scenes that both know the measure of."""
    rows = []
    for title, name, factor, digits, unit, better in _MEASURES:
        known = [
            (factor * first, factor * second)
            for here, there in pairs
            if (name != "depth_error_median" or (here.metric is True and there.metric is True))
            and (first := number(getattr(here, name))) is not None
            and (second := number(getattr(there, name))) is not None
        ]
        here, there = median([one for one, _ in known]), median([one for _, one in known])
        if here is not None and there is not None:
            change = here - there
            rows.append(
                {
                    "title": title,
                    "count": len(known),
                    "here": f"{here:.{digits}f}{unit}",
                    "there": f"{there:.{digits}f}{unit}",
                    "change": f"{change:+.{digits}f}{unit}",
                    "good": None if float(f"{change:.{digits}f}") == 0 else change * better > 0,
                }
            )
    return rows


def _settings(run: Run, other: Run) -> list[dict[str, str]]:
    """Settings that are not the same in both, and the version."""
    here, there = ({"version": one.version, **dict(flat(one.config))} for one in (run, other))
    return [
        {"name": printable(name), "here": printable(here.get(name, "–")), "there": printable(there.get(name, "–"))}
        for name in dict.fromkeys((*here, *there))
        if here.get(name) != there.get(name)
    ]
