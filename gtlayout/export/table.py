"""Instances, dimensions, areas and measurements as one CSV table, a row each."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

from gtlayout.accuracy import SIGMAS_95, Accuracy
from gtlayout.export import unit
from gtlayout.io.files import printable, write_atomic
from gtlayout.layout import Layout
from gtlayout.scene import Scene

COLUMNS = ("kind", "of", "value", "unit", "sigma", "error_95", "loa", "status")
_Row = tuple[str | float | int, ...]


def write(path: Path, _scene: Scene, layout: Layout) -> None:
    """Write the table, RFC 4180 with a head. Values are in the unit that the row names, σ and the error at 95 % too.

    Surfaces have their error at 95 % and the area that was seen; flatness is how far they bulge into the room; inferred
    is the area that closes it where nobody looked. Empty = not known. Raises GtlayoutError when the disk does not take
    it.
    """
    text = io.StringIO(newline="")
    table = csv.writer(text)
    table.writerow(COLUMNS)
    table.writerows([_plain(value) for value in row] for row in _rows(layout))
    write_atomic(path, text.getvalue().encode())


def _rows(layout: Layout) -> list[_Row]:
    length = unit(layout.metric)
    names = [printable(instance.name) for instance in layout.instances]
    accuracies = layout.accuracies or (None,) * len(names)
    rows: list[_Row] = []
    for name, extent, accuracy in zip(names, layout.extents, accuracies, strict=True):
        error, *level = _accuracy(accuracy)
        rows.append(("surface", name, extent.region.area, f"{length}²", math.nan, error, *level))
    for name, flat in zip(names, layout.flatness or (None,) * len(names), strict=True):
        if flat is not None:
            rows.append(("flatness", name, flat.deviation, length, flat.sigma, SIGMAS_95 * flat.sigma, "", flat.status))
    for name, extent in zip(names, layout.inferred, strict=False):
        if not extent.region.is_empty:
            rows.append(("inferred", name, extent.region.area, f"{length}²", math.nan, math.nan, "", "inferred"))
    for one in layout.dimensions:
        of = names[one.first] if one.first == one.second else f"{names[one.first]} – {names[one.second]}"
        rows.append((one.kind, of, one.length, length, one.sigma, SIGMAS_95 * one.sigma, *_accuracy(one.accuracy)[1:]))
    for i, on in layout.curved.items():
        rows.append(("radius", names[i], on.radius, length, on.sigma_radius, SIGMAS_95 * on.sigma_radius, "", ""))
    for amount in layout.quantities:
        of = " + ".join(names[i] for i in amount.instances)
        power = "³" if amount.kind == "volume" else "²"
        seen = "" if amount.closed else "at least: not all of the outline was seen"
        rows.append((amount.kind, of, amount.amount, length + power, amount.sigma, SIGMAS_95 * amount.sigma, "", seen))
    for each in layout.measurements:
        hand = each.measurement
        used = "used" if each.used else "not used: contradicts everything else"
        rows.append(
            ("measured", printable(hand.name), hand.value, hand.unit, hand.sigma, SIGMAS_95 * hand.sigma, "", used)
        )
    return rows


def _accuracy(accuracy: Accuracy | None) -> tuple[float, int | str, str]:
    if accuracy is None:
        return math.nan, "", ""
    return accuracy.error_95_m, accuracy.level, accuracy.status


def _plain(value: str | float) -> str | float:
    """Empty for what is not known; a text that a spreadsheet would take for a formula is quoted as text."""
    if isinstance(value, float) and not math.isfinite(value):
        return ""
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@") else value
