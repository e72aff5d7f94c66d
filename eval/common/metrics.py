"""One results format for every evaluation: metrics in rows, as a Markdown table, CSV and JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
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
    """What is measured: ``iou``, ``depth_error`` … Key and unit together make a column of a table."""
    value: float
    """NaN when there is nothing to measure."""
    unit: str
    """``m``, ``px``, ``°``, ``s`` …; empty for shares and counts."""
    higher_is_better: bool | None
    """None for what is neither good nor bad, such as a number of scenes."""


def mean_over(rows: Sequence[Sequence[Metric]]) -> list[Metric]:
    """The mean of each metric over the rows that have a value for it; NaN where none has. Order of first appearance.

    The same metric in two units (metres in one scene, its own unit in another) has two means.
    """
    return [replace(first, value=_mean(cells)) for first, cells in _columns(rows)]


def markdown_table(rows: Rows, row_title: str) -> str:
    """A table with a column per metric and unit; arrows say which way is better. What has no value is a dash.

    The decimals of a column are such that its median shows three digits, and its smallest value two.
    """
    arrows = {True: " ↑", False: " ↓", None: ""}
    columns = [[row_title, "---", *rows]]
    for first, cells in _columns(list(rows.values())):
        head = first.key + (f", {first.unit}" if first.unit else "") + arrows[first.higher_is_better]
        decimals = _decimals(cells)
        columns.append([head, "---:", *(_shown(value, decimals) for value in cells)])
    lines = [
        " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in line) for line in zip(*columns, strict=True)
    ]
    return "".join(f"| {line} |\n" for line in lines)


def csv_table(rows: Rows, row_title: str) -> str:
    """The same for spreadsheets: full precision, units in the column's name, empty where there is no value."""
    columns = [[row_title, *rows]]
    for first, cells in _columns(list(rows.values())):
        head = first.key + (f"_{first.unit}" if first.unit else "")
        columns.append([head, *(repr(float(value)) if np.isfinite(value) else "" for value in cells)])
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(zip(*columns, strict=True))
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
    if not isinstance(key, str) or not isinstance(unit, str) or higher_is_better not in (True, False, None):
        raise TypeError(f"no metric: {key!r}, {unit!r}, {higher_is_better!r}")
    return Metric(key, np.nan if value is None else float(value), unit, higher_is_better)


def _columns(rows: Sequence[Sequence[Metric]]) -> list[tuple[Metric, list[float]]]:
    """For each key and unit, in order of appearance, its first metric and a value per row, NaN where it has none."""
    first: dict[tuple[str, str], Metric] = {}
    for row in rows:
        for metric in row:
            first.setdefault((metric.key, metric.unit), metric)
    by_row = [{(metric.key, metric.unit): metric.value for metric in row} for row in rows]
    return [(metric, [values.get(column, np.nan) for values in by_row]) for column, metric in first.items()]


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else np.nan


def _decimals(values: Sequence[float]) -> int:
    """Decimals at which the median of a column shows three digits and the smallest value two; none for whole numbers.

    Millimetres of one method beside metres of another want four decimals; no more for the sake of the smallest.
    """
    sizes = [abs(value) for value in values if np.isfinite(value) and value != 0]
    if all(size == round(size) for size in sizes):
        return 0
    median, smallest = (int(np.floor(np.log10(size))) for size in (np.median(sizes), min(sizes)))
    return min(max(2 - median, min(1 - smallest, 4), 0), 6)


def _shown(value: float, decimals: int) -> str:
    if not np.isfinite(value):
        return "–"
    if 0 < abs(value) < 0.5 * 10.0**-decimals:
        return f"{value:.1e}"  # "0.000" would say that it is zero
    return f"{value + 0.0:.{decimals}f}"  # + 0.0: never "-0"
