"""``measurements.json``: what was measured in the room by hand, edited by hand or by ``gtlayout measure``.

A list; ``sigma_m`` (``sigma_deg`` of angles) may be left out::

    [
      {"between": ["floor_0", "ceiling_0"], "metres": 2.513, "sigma_m": 0.003},
      {"width": "door_0", "metres": 0.885},
      {"height": "window_0", "metres": 1.31},
      {"sill": "window_0", "metres": 0.9},
      {"angle": ["wall_0", "wall_1"], "degrees": 90.4},
      {"points": [{"a.jpg": [x, y], "b.jpg": [x, y]}, {…}], "metres": 3.2}
    ]

Names are those of the solved layout. ``"elements": [["a.jpg", "7"], …]``, image and id of an element of each, keeps an
entry right when instances are numbered anew; ``gtlayout measure`` writes it. ``"assumed": true`` marks what was not
measured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json_list, write_json_atomic
from gtlayout.io.image_names import NameIndex
from gtlayout.io.marked_points import marks_of
from gtlayout.measurement import ElementName, MarkedPoint, MeasuredKind, Measurement
from gtlayout.scene import Frame, Scene

FILE = "measurements.json"
SIGMA_M, SIGMA_DEG = 0.003, 0.5
"""Of a tape or laser, and of a set square, where the file says nothing."""
MAX_METRES = 1000.0
MAX_MEASUREMENTS = 1000
_PAIRS: tuple[MeasuredKind, ...] = ("between", "angle")


def read_measurements(path: Path, frames: Sequence[Frame]) -> tuple[Measurement, ...]:
    """Read ``measurements.json``, which need not exist.

    Raises GtlayoutError naming the file and the entry when it cannot be what someone measured.
    """
    if not path.exists():
        return ()
    entries = read_json_list(path)
    if len(entries) > MAX_MEASUREMENTS:
        raise GtlayoutError(f"{path}: more than {MAX_MEASUREMENTS} measurements")
    names = NameIndex([frame.name for frame in frames])
    return tuple(_measurement(entry, frames, names, f"{path}, entry {n}") for n, entry in enumerate(entries, start=1))


def write_measurements(path: Path, scene: Scene, frames: Sequence[Frame], ids: Mapping[tuple[int, int], str]) -> None:
    """Write a scene's measurements for the same scene with other ``frames``, pinhole images in the same order.

    ``ids`` are those of its elements there, by key frame and element.
    """
    renamed = {old.name: new.name for old, new in zip(scene.frames, frames, strict=True)}
    elements = {
        ElementName(scene.frame_of(k).name, scene.key_frames[k].elements[e].id): ElementName(
            renamed[scene.frame_of(k).name], name
        )
        for (k, e), name in ids.items()
    }
    moved = [
        replace(
            one,
            elements=tuple(None if name is None else elements.get(name) for name in one.elements),
            points=tuple(tuple((renamed[name], px) for name, px in point) for point in one.points),
        )
        for one in scene.measurements
    ]
    write_json_atomic(path, [measurement_entry(one) for one in moved])


def measurement_entry(measurement: Measurement) -> dict[str, Any]:
    """The entry that reads as this measurement; pixels of points are those of pinhole images."""
    kind = measurement.kind
    of: Any = [{name: list(px) for name, px in point} for point in measurement.points]
    if kind != "points":
        of = list(measurement.instances) if kind in _PAIRS else measurement.instances[0]
    value, sigma = ("degrees", "sigma_deg") if kind == "angle" else ("metres", "sigma_m")
    entry: dict[str, Any] = {kind: of, value: measurement.value, sigma: measurement.sigma}
    if any(measurement.elements):
        entry["elements"] = [None if one is None else [one.image, one.element] for one in measurement.elements]
    return entry | ({"assumed": True} if measurement.assumed else {})


def _measurement(entry: Any, frames: Sequence[Frame], names: NameIndex, where: str) -> Measurement:
    if not isinstance(entry, dict):
        raise GtlayoutError(f"{where}: must be an object, not {entry!r}")
    kinds: list[MeasuredKind] = [kind for kind in get_args(MeasuredKind) if kind in entry]
    if len(kinds) != 1:
        raise GtlayoutError(f"{where}: must have one of {', '.join(get_args(MeasuredKind))}")
    kind = kinds[0]
    value_key, sigma_key = ("degrees", "sigma_deg") if kind == "angle" else ("metres", "sigma_m")
    unknown = set(entry) - {kind, value_key, sigma_key, "elements", "assumed"}
    if unknown:
        raise GtlayoutError(f"{where}: what is {sorted(unknown)[0]!r}? An entry has {kind}, {value_key}, {sigma_key}")
    most = 180.0 if kind == "angle" else MAX_METRES
    value = _number(entry.get(value_key), most, f"{where}: {value_key}")
    sigma = _number(entry.get(sigma_key, SIGMA_DEG if kind == "angle" else SIGMA_M), most, f"{where}: {sigma_key}")
    assumed = entry.get("assumed", False)
    if not isinstance(assumed, bool):
        raise GtlayoutError(f"{where}: assumed must be true or false")
    if kind == "points":
        return Measurement(kind, (), value, sigma, points=_points(entry[kind], frames, names, where), assumed=assumed)
    instances = _names(entry[kind], 2 if kind in _PAIRS else 1, f"{where}: {kind}")
    elements = _elements(entry.get("elements"), len(instances), where)
    return Measurement(kind, instances, value, sigma, elements, assumed=assumed)


def _number(value: Any, most: float, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= most:
        raise GtlayoutError(f"{what} must be a positive number up to {most:g}, not {value!r}")
    return float(value)


def _names(value: Any, count: int, what: str) -> tuple[str, ...]:
    names = [value] if count == 1 else value
    good = isinstance(names, list) and len(names) == count and all(isinstance(name, str) and name for name in names)
    if not good or len(set(names)) < count:
        wanted = "the name of an instance" if count == 1 else "the names of two instances"
        raise GtlayoutError(f"{what} must be {wanted}, not {value!r}")
    return tuple(names)


def _elements(value: Any, count: int, where: str) -> tuple[ElementName | None, ...]:
    if value is None:
        return ()
    if not isinstance(value, list) or len(value) != count:
        raise GtlayoutError(f"{where}: elements must be [image, id] of each instance")
    found: list[ElementName | None] = []
    for one in value:
        if one is not None and not (isinstance(one, list) and len(one) == 2 and all(isinstance(n, str) for n in one)):
            raise GtlayoutError(f"{where}: elements must be [image, id] of each instance, not {one!r}")
        found.append(None if one is None else ElementName(*one))
    return tuple(found)


def _points(value: Any, frames: Sequence[Frame], names: NameIndex, where: str) -> tuple[MarkedPoint, ...]:
    if not isinstance(value, list) or len(value) != 2:
        raise GtlayoutError(f"{where}: points must be a list of two")
    found = []
    for number, point in enumerate(value, start=1):
        marks = marks_of(point, frames, names, f"{where}, point {number}")
        found.append(tuple((mark.frame, (float(mark.px[0]), float(mark.px[1]))) for mark in marks))
    return tuple(found)
