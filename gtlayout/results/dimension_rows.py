"""What a room measures, as rows of layout.json: dimensions, quantities, measurements by hand, levels of accuracy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np

from gtlayout.accuracy import UPPER_ENDS_M, Accuracy, Flatness, Status
from gtlayout.instances import Dimension, DimensionKind, NextMeasurement, Quantity, QuantityKind
from gtlayout.io.numbers import MOST, real, reals, whole
from gtlayout.layout import Layout
from gtlayout.measurement import Checked, MeasuredKind, Measurement, Scale
from gtlayout.results.layout_format import (
    AccuracyRow,
    DimensionRow,
    FlatnessRow,
    MeasurementRow,
    NextMeasurementRow,
    QuantityRow,
    ScaleRow,
)


def accuracy_row(accuracy: Accuracy | None) -> AccuracyRow | None:
    """One level of accuracy; None where nobody asked."""
    if accuracy is None:
        return None
    return {
        "error_95_m": accuracy.error_95_m,
        "level": accuracy.level,
        "status": accuracy.status,
        "wanted": accuracy.wanted,
    }


def flatness_row(flatness: Flatness | None) -> FlatnessRow | None:
    """How flat one surface is; None for doors and windows, and where nobody asked."""
    if flatness is None:
        return None
    return {
        "deviation": flatness.deviation,
        "sigma": flatness.sigma,
        "distance": flatness.distance,
        "limit_m": flatness.limit_m,
        "line": flatness.line,
        "status": flatness.status,
    }


def dimension_rows(layout: Layout) -> list[DimensionRow]:
    """One row a dimension."""
    return [
        {
            "kind": one.kind,
            "between": [layout.instances[i].name for i in (one.first, one.second)],
            "length": one.length,
            "sigma": one.sigma,
            "ends": one.ends_world,
            "accuracy": accuracy_row(one.accuracy),
        }
        for one in layout.dimensions
    ]


def quantity_rows(layout: Layout) -> list[QuantityRow]:
    """One row an area or a volume."""
    return [
        {
            "kind": one.kind,
            "of": [layout.instances[i].name for i in one.instances],
            "amount": one.amount,
            "sigma": one.sigma,
            "closed": one.closed,
        }
        for one in layout.quantities
    ]


def measurement_rows(layout: Layout) -> list[MeasurementRow]:
    """One row a measurement by hand."""
    return [
        {
            "kind": one.measurement.kind,
            "of": list(one.measurement.instances),
            "value": one.measurement.value,
            "sigma": one.measurement.sigma,
            "assumed": one.measurement.assumed,
            "predicted": one.predicted,
            "predicted_sigma": one.predicted_sigma,
            "used": one.used,
        }
        for one in layout.measurements
    ]


def scale_row(layout: Layout) -> ScaleRow | None:
    """The scale, where anything tells it."""
    scale = layout.scale
    if scale is None:
        return None
    return {"factor": scale.factor, "sigma_share": scale.sigma_share, "gave_unit": scale.gave_unit}


def next_row(layout: Layout) -> NextMeasurementRow | None:
    """What to measure next, if anything."""
    one = layout.next_measurement
    if one is None:
        return None
    return {"dimension": one.dimension, "within": one.within, "reached": one.reached, "of": one.of}


def read_next(row: dict[str, Any] | None, dimensions: int) -> NextMeasurement | None:
    """The inverse of ``next_row``. Raises KeyError, TypeError or ValueError when the row is damaged."""
    if row is None:
        return None
    if row["dimension"] not in range(dimensions):
        raise ValueError(f"no dimension {row['dimension']!r}")
    return NextMeasurement(*(whole(row[name]) for name in ("dimension", "within", "reached", "of")))


def read_accuracy(row: dict[str, Any] | None) -> Accuracy | None:
    """The inverse of ``accuracy_row``. Raises KeyError, TypeError or ValueError when the row is damaged."""
    if row is None:
        return None
    level = _one_of(row["level"], (0, *UPPER_ENDS_M), "level of accuracy")
    wanted = _one_of(row["wanted"], tuple(UPPER_ENDS_M), "level of accuracy")
    return Accuracy(read_sigma(row["error_95_m"]), level, _one_of(row["status"], get_args(Status), "status"), wanted)


def read_flatness(row: dict[str, Any] | None) -> Flatness | None:
    """The inverse of ``flatness_row``. Raises KeyError, TypeError or ValueError when the row is damaged."""
    if row is None:
        return None
    return Flatness(
        real(row["deviation"], unknown=True),
        read_sigma(row["sigma"]),
        real(row["distance"], unknown=True),
        real(row["limit_m"], unknown=True),
        whole(row["line"]),
        _one_of(row["status"], get_args(Status), "status"),
    )


def read_dimension(row: dict[str, Any], names: Sequence[str]) -> Dimension:
    """The inverse of ``dimension_rows``, for one. Raises KeyError, TypeError or ValueError when the row is damaged."""
    first, second = (names.index(name) for name in row["between"])
    return Dimension(
        first,
        second,
        _one_of(row["kind"], get_args(DimensionKind), "kind of dimension"),
        real(row["length"], unknown=True),
        read_sigma(row["sigma"]),
        reals(row["ends"], (2, 3), unknown=True),
        read_accuracy(row["accuracy"]),
    )


def read_quantity(row: dict[str, Any], names: Sequence[str]) -> Quantity:
    """The inverse of ``quantity_rows``, for one. Raises KeyError, TypeError or ValueError when the row is damaged."""
    return Quantity(
        _one_of(row["kind"], get_args(QuantityKind), "kind of quantity"),
        tuple(names.index(name) for name in row["of"]),
        real(row["amount"], most=MOST**3, unknown=True),
        read_sigma(row["sigma"]),
        bool(row["closed"]),
    )


def read_measurement(row: dict[str, Any]) -> Checked:
    """The inverse of ``measurement_rows``, for one. Raises KeyError, TypeError or ValueError when it is damaged."""
    measurement = Measurement(
        _one_of(row["kind"], get_args(MeasuredKind), "kind of measurement"),
        tuple(str(name) for name in row["of"]),
        real(row["value"], unknown=True),
        read_sigma(row["sigma"]),
        assumed=bool(row["assumed"]),
    )
    return Checked(
        measurement, real(row["predicted"], unknown=True), read_sigma(row["predicted_sigma"]), bool(row["used"])
    )


def read_scale(row: dict[str, Any] | None) -> Scale | None:
    """The inverse of ``scale_row``. Raises KeyError, TypeError or ValueError when the row is damaged."""
    if row is None:
        return None
    return Scale(real(row["factor"], unknown=True), real(row["sigma_share"], unknown=True), bool(row["gave_unit"]))


def read_sigma(value: Any) -> float:
    """A σ. Of a plane that hardly anything places it may be huge, and null where nothing does."""
    return real(value, most=np.finfo(np.float64).max, unknown=True)


def _one_of(value: Any, known: Sequence[Any], what: str) -> Any:
    if value not in known:
        raise ValueError(f"unknown {what} {value!r}")
    return value
