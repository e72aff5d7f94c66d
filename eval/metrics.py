"""One results format for every evaluation: metrics in rows, as a Markdown table, CSV and JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import json_text, read_json, write_all_atomic

FORMAT = "gtlayout-results/1"
Rows = Mapping[str, Sequence["Metric"]]
"""Label of the row (a scene, a variant of the method) → what was measured for it."""


@dataclass(frozen=True)
class Metric:
    """One measured number."""

    key: str
    """Column it belongs to: ``iou``, ``depth_error`` …"""
    value: float
    """NaN when there is nothing to measure."""
    unit: str
    """``m``, ``px``, ``°``, ``s`` …; empty for shares and counts."""
    higher_is_better: bool | None
    """None for what is neither good nor bad, such as a number of scenes."""


def mean_over(rows: Sequence[Sequence[Metric]]) -> list[Metric]:
    """The mean of each metric over the rows that have a value for it; NaN where none has. Order of first appearance."""
    by_key: dict[str, list[Metric]] = {}
    for row in rows:
        for metric in row:
            by_key.setdefault(metric.key, []).append(metric)
    means = []
    for key, metrics in by_key.items():
        values = [metric.value for metric in metrics if np.isfinite(metric.value)]
        first = metrics[0]
        means.append(Metric(key, float(np.mean(values)) if values else np.nan, first.unit, first.higher_is_better))
    return means


def markdown_table(rows: Rows, row_title: str) -> str:
    """A table with one column per key; arrows say which way is better. What a row lacks is a dash."""
    columns = _columns(rows)
    arrows = {True: " ↑", False: " ↓", None: ""}
    heads = [m.key + (f", {m.unit}" if m.unit else "") + arrows[m.higher_is_better] for m in columns.values()]
    lines = [[row_title, *heads], ["---", *("---:" for _ in heads)]]
    for label, metrics in rows.items():
        values = {metric.key: metric.value for metric in metrics}
        lines.append([label.replace("|", "\\|"), *(_shown(values.get(key, np.nan)) for key in columns)])
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def csv_table(rows: Rows, row_title: str) -> str:
    """The same for spreadsheets: full precision, units in the column's name, empty where there is no value."""
    columns = _columns(rows)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([row_title, *(m.key + (f"_{m.unit}" if m.unit else "") for m in columns.values())])
    for label, metrics in rows.items():
        values = {metric.key: metric.value for metric in metrics if np.isfinite(metric.value)}
        writer.writerow([label, *(values.get(key, "") for key in columns)])
    return text.getvalue()


def write_tables(out_dir: Path, name: str, rows: Rows, row_title: str) -> None:
    """Write ``name``.md, ``name``.csv and ``name``.json to ``out_dir``, all or none.

    Raises:
        GtlayoutError: the folder or disk does not take them.
    """
    data = {"format": FORMAT, "rows": {label: [asdict(metric) for metric in row] for label, row in rows.items()}}
    write_all_atomic(
        {
            out_dir / f"{name}.md": markdown_table(rows, row_title),
            out_dir / f"{name}.csv": csv_table(rows, row_title),
            out_dir / f"{name}.json": json_text(data),
        }
    )


def read_rows(path: Path) -> dict[str, list[Metric]]:
    """Read a JSON file of ``write_tables`` back.

    Raises:
        GtlayoutError: the file is absent, damaged or something else.
    """
    data = read_json(path)
    if data.get("format") != FORMAT:
        raise GtlayoutError(f'{path} holds no results: its "format" is {data.get("format")!r}, not {FORMAT!r}')
    try:
        return {label: [_metric(**metric) for metric in row] for label, row in data["rows"].items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise GtlayoutError(f"{path} is damaged: {type(error).__name__} {error}; remove it and run again") from error


def _metric(key: str, value: float | None, unit: str, higher_is_better: bool | None) -> Metric:
    """JSON has no NaN: null stands for it."""
    return Metric(key, np.nan if value is None else float(value), unit, higher_is_better)


def _columns(rows: Rows) -> dict[str, Metric]:
    """The first metric of each key, in order of appearance."""
    columns: dict[str, Metric] = {}
    for metrics in rows.values():
        for metric in metrics:
            columns.setdefault(metric.key, metric)
    return columns


def _shown(value: float) -> str:
    """Three significant digits, whole numbers as such."""
    if not np.isfinite(value):
        return "–"
    return f"{value:.0f}" if value == round(value) and abs(value) >= 2 else f"{value:.3g}"
