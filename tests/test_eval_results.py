"""The results format of evaluations: tables for people and spreadsheets, and JSON that reads back equal."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.metrics import FORMAT, Metric, csv_table, markdown_table, mean_over, read_rows, write_tables
from gtlayout.errors import GtlayoutError


def _iou(value: float) -> Metric:
    return Metric("iou", value, "", True)


def _depth(value: float, unit: str = "m") -> Metric:
    return Metric("depth_error", value, unit, False)


def _count(value: float) -> Metric:
    return Metric("scenes", float(value), "", None)


ROWS = {
    "office": [_count(1), _iou(0.9791), _depth(0.0341)],
    "kitchen|west": [_count(12), _iou(1.0), _depth(np.nan)],
    "hall": [_iou(0.5)],
}


def test_markdown_table() -> None:
    """Arrows, units, three digits, whole counts; a dash for NaN and for what a row lacks; | in a label escaped."""
    assert markdown_table(ROWS, "scene") == (
        "| scene | scenes | iou ↑ | depth_error, m ↓ |\n"
        "| --- | ---: | ---: | ---: |\n"
        "| office | 1 | 0.979 | 0.0341 |\n"
        "| kitchen\\|west | 12 | 1.000 | – |\n"
        "| hall | – | 0.500 | – |\n"
    )


def test_table_without_rows_or_metrics() -> None:
    assert markdown_table({}, "scene") == "| scene |\n| --- |\n"
    assert markdown_table({"a": []}, "scene") == "| scene |\n| --- |\n| a |\n"
    assert csv_table({}, "scene") == "scene\n"


@pytest.mark.parametrize(
    ("values", "shown"),
    [
        ([0.0, 1.0, 1.0], ["0", "1", "1"]),
        ([0.0, 1.0, 0.5], ["0.000", "1.000", "0.500"]),
        ([1234.5, 987.6], ["1234", "988"]),
        ([10.04, 9.96], ["10.0", "10.0"]),
        ([3.204, 5.0, 120.44], ["3.20", "5.00", "120.44"]),
        ([0.0312, 0.2501, 0.0288], ["0.0312", "0.2501", "0.0288"]),
        ([1e-9, 0.0, -2e-12], ["1.0e-09", "0.000000", "-2.0e-12"]),
        ([0.5, 1e-7], ["0.5000", "1.0e-07"]),
        ([3.352, 0.0076, 2.5], ["3.3520", "0.0076", "2.5000"]),
        ([-0.0, -1.5], ["0.00", "-1.50"]),
        ([np.inf, np.nan, 2.0], ["–", "–", "2"]),
        ([np.nan], ["–"]),
    ],
)
def test_values_of_a_column_share_their_decimals(values: list[float], shown: list[str]) -> None:
    table = markdown_table({str(i): [_iou(value)] for i, value in enumerate(values)}, "row").splitlines()[2:]
    assert [line.split("|")[2].strip() for line in table] == shown


def test_line_breaks_and_bars_do_not_break_the_table() -> None:
    rows = {"two\nlines": [Metric("a|b", 1.0, "m|s", None)]}
    assert markdown_table(rows, "x|y").splitlines() == [r"| x\|y | a\|b, m\|s |", "| --- | ---: |", "| two lines | 1 |"]


def test_csv_has_units_full_precision_and_empty_cells() -> None:
    rows = {**ROWS, 'with, "quotes"': [_depth(0.1 + 0.2)]}
    assert csv_table(rows, "scene").splitlines()[0] == "scene,scenes,iou,depth_error_m"
    table = list(csv.reader(csv_table(rows, "scene").splitlines()))
    assert table[1] == ["office", "1.0", "0.9791", "0.0341"]
    assert table[2] == ["kitchen|west", "12.0", "1.0", ""]
    assert table[4] == ['with, "quotes"', "", "", "0.30000000000000004"]
    assert csv_table({"a": [_iou(float(np.float64(0.25)))]}, "x") == csv_table({"a": [_iou(np.float64(0.25))]}, "x")


def test_metres_and_scene_units_are_two_columns_and_two_means() -> None:
    rows = {"metric": [_depth(0.02)], "other": [_depth(3.0, "scene unit")], "third": [_depth(0.04)]}
    assert markdown_table(rows, "scene").splitlines()[0] == "| scene | depth_error, m ↓ | depth_error, scene unit ↓ |"
    assert csv_table(rows, "scene").splitlines()[2] == "other,,3.0"
    assert mean_over(list(rows.values())) == [_depth(0.03), _depth(3.0, "scene unit")]


def test_mean_skips_what_has_no_value() -> None:
    means = mean_over(list(ROWS.values()))
    assert [(mean.key, mean.unit, mean.higher_is_better) for mean in means] == [
        ("scenes", "", None),
        ("iou", "", True),
        ("depth_error", "m", False),
    ]
    assert [mean.value for mean in means] == pytest.approx([6.5, (0.9791 + 1.5) / 3, 0.0341])
    assert mean_over([]) == []
    with np.errstate(all="raise"):
        (nothing,) = mean_over([[_iou(np.nan)], [_iou(np.inf)]])
    assert np.isnan(nothing.value)


def test_tables_are_written_together_and_read_back_equal(tmp_path: Path) -> None:
    write_tables(tmp_path / "new", "table", ROWS, "scene")
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["table.csv", "table.json", "table.md"]
    assert (tmp_path / "new/table.md").read_text(encoding="utf-8") == markdown_table(ROWS, "scene")
    assert (tmp_path / "new/table.csv").read_text(encoding="utf-8") == csv_table(ROWS, "scene")
    back = read_rows(tmp_path / "new/table.json")
    # NaN is not equal to itself, but its text is.
    assert repr(back) == repr(ROWS)
    assert "NaN" not in (tmp_path / "new/table.json").read_text()
    before = (tmp_path / "new/table.json").read_bytes()
    write_tables(tmp_path / "new", "table", back, "scene")
    assert (tmp_path / "new/table.json").read_bytes() == before


def test_folder_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(GtlayoutError, match=r"cannot write .*file"):
        write_tables(tmp_path / "file", "table", ROWS, "scene")


METRIC = {"key": "iou", "value": 1.0, "unit": "", "higher_is_better": True}


@pytest.mark.parametrize(
    "data",
    [
        pytest.param({}, id="no format"),
        pytest.param({"format": "gtlayout-layout/1", "rows": {}}, id="another format"),
        pytest.param({"format": FORMAT}, id="no rows"),
        pytest.param({"format": FORMAT, "rows": []}, id="rows are a list"),
        pytest.param({"format": FORMAT, "rows": {"a": 1}}, id="a row is a number"),
        pytest.param({"format": FORMAT, "rows": {"a": ["iou"]}}, id="a metric is a word"),
        pytest.param({"format": FORMAT, "rows": {"a": [{"key": "iou"}]}}, id="a metric lacks its value"),
        pytest.param({"format": FORMAT, "rows": {"a": [METRIC | {"value": "x"}]}}, id="a value is a word"),
        pytest.param({"format": FORMAT, "rows": {"a": [METRIC | {"unit": None}]}}, id="no unit"),
        pytest.param({"format": FORMAT, "rows": {"a": [METRIC | {"key": 3}]}}, id="a key is a number"),
        pytest.param({"format": FORMAT, "rows": {"a": [METRIC | {"higher_is_better": "up"}]}}, id="no direction"),
        pytest.param({"format": FORMAT, "rows": {"a": [METRIC | {"more": 1}]}}, id="a field too many"),
    ],
)
def test_damaged_file_is_one_clear_line(tmp_path: Path, data: dict[str, Any]) -> None:
    path = tmp_path / "table.json"
    path.write_text(json.dumps(data))
    with pytest.raises(GtlayoutError, match=r"table\.json") as caught:
        read_rows(path)
    assert "\n" not in str(caught.value)


def test_cut_off_and_absent_files(tmp_path: Path) -> None:
    write_tables(tmp_path, "table", ROWS, "scene")
    path = tmp_path / "table.json"
    path.write_bytes(path.read_bytes()[:-20])
    for name in ("table.json", "absent.json"):
        with pytest.raises(GtlayoutError, match=name):
            read_rows(tmp_path / name)
