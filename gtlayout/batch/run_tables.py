"""The records of a run as one table, in two files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields
from io import BytesIO
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from gtlayout.batch.record import CSV_FILE, PARQUET_FILE, Record
from gtlayout.io.files import write_all_atomic

_TYPES = {"str": pa.string(), "float": pa.float64(), "int": pa.int64(), "bool": pa.bool_()}


def write_tables(folder: Path, records: Iterable[Record]) -> None:
    """Write run.csv and run.parquet: one row per scene, sorted by name, the same columns in both.

    Raises GtlayoutError when the disk does not take them.
    """
    table = _table(sorted(records, key=lambda record: record.scene))
    csv, parquet = BytesIO(), BytesIO()
    pyarrow.csv.write_csv(table, csv)
    pyarrow.parquet.write_table(table, parquet)
    write_all_atomic({folder / CSV_FILE: csv.getvalue(), folder / PARQUET_FILE: parquet.getvalue()})


def _table(records: Sequence[Record]) -> pa.Table:
    """Columns in the order of ``Record``'s fields; the seconds of each stage are columns of their own."""
    columns: dict[str, pa.Array] = {}
    for one in fields(Record):
        if one.name == "stages_s":
            stages = dict.fromkeys(stage for record in records for stage in record.stages_s)
            columns |= {
                f"seconds_{stage}": pa.array([record.stages_s.get(stage) for record in records], pa.float64())
                for stage in stages
            }
        elif one.name != "files":
            kind = _TYPES.get(str(one.type).removesuffix(" | None"), pa.string())
            columns[one.name] = pa.array([getattr(record, one.name) for record in records], kind)
    return pa.table(columns)
