"""Faults of the files that may lie beside cameras and drawings, and of COLMAP's."""

from __future__ import annotations

import json
from functools import partial
from typing import Any

from faulty.case import Case
from faulty.spoil import a_folder, cut, edited, gone, put, replaced

UNIT, MEASURED, LABELS, TRUTH = "scene.json", "measurements.json", "labels.json", "gt_planes.json"
unit = partial(Case, "Unit (scene.json)")
measured = partial(Case, "Measurements (measurements.json)")
labels = partial(Case, "Labels (labels.json)")
truth = partial(Case, "Truth (gt_planes.json)", command=("evaluate", "SCENE"), room="solved")
colmap = partial(Case, "COLMAP", room="colmap")


def tape(**values: Any) -> Any:
    """One measurement, with other values."""
    return put(MEASURED, json.dumps([{"between": ["floor_0", "ceiling_0"], "metres": 2.5} | values]))


def first_plane(**values: Any) -> Any:
    """The first true plane, with other values."""
    return edited(TRUTH, lambda data: next(iter(data["planes"].values())).update(values))


IMAGES, CAMERAS = "sparse/0/images.txt", "sparse/0/cameras.txt"

CASES = (
    unit("missing", "no scene.json", gone(UNIT), 0, ("nothing suspicious", "metric")),
    unit("missing", "nothing in it", put(UNIT, "{}"), 1, (UNIT, 'must be {"unit": …}')),
    unit("truncated", "half of the file", cut(UNIT), 1, (UNIT, "is not valid JSON")),
    unit("truncated", "an empty file", put(UNIT, ""), 1, (UNIT, "is not valid JSON")),
    unit("wrong unit", "a unit nobody knows", put(UNIT, '{"unit": "mile"}'), 1, (UNIT, '"mm"')),
    unit("wrong unit", "metres that are millimetres", put(UNIT, '{"unit": "mm"}'), 3, ("no room is that size",)),
    unit("wrong unit", "two things at once", put(UNIT, '{"unit": "mm", "metric": false}'), 1, (UNIT, "is not known")),
    unit("NaN", "σ of the scale", put(UNIT, '{"unit": "m", "scale_sigma": NaN}'), 1, (UNIT, "scale_sigma")),
    unit("negative", "σ of the scale", put(UNIT, '{"unit": "m", "scale_sigma": -0.1}'), 1, (UNIT, "scale_sigma")),
    unit("huge", "σ of the scale", put(UNIT, '{"unit": "m", "scale_sigma": 7}'), 1, (UNIT, "scale_sigma")),
    measured("truncated", "half of a file", put(MEASURED, '[{"between": ["fl'), 1, (MEASURED, "is not valid JSON")),
    measured("no such file", "no list", put(MEASURED, "{}"), 1, (MEASURED, "must hold a JSON list")),
    measured("no such file", "a folder in its place", a_folder(MEASURED), 1, (MEASURED,)),
    measured("NaN", "a length", tape(metres=float("nan")), 1, (MEASURED, "entry 1")),
    measured("infinite", "a length", tape(metres=float("inf")), 1, (MEASURED, "entry 1")),
    measured("zero", "a length", tape(metres=0), 1, (MEASURED, "entry 1")),
    measured("negative", "a length", tape(metres=-2.5), 1, (MEASURED, "entry 1")),
    measured("huge", "a length of 5 km", tape(metres=5000), 1, (MEASURED, "entry 1")),
    measured("zero", "a σ", tape(sigma_m=0), 1, (MEASURED, "entry 1")),
    measured("wrong unit", "millimetres for metres", tape(metres=2500), 1, (MEASURED, "entry 1")),
    measured(
        "missing",
        "an instance that is not there",
        tape(between=["floor_7", "ceiling_0"]),
        0,
        ("floor_7",),
        ("solve", "SCENE", "-v"),
        "room",
        slow=True,
    ),
    measured("wrong type", "of one instance to itself", tape(between=["floor_0", "floor_0"]), 1, (MEASURED, "entry 1")),
    measured("huge", "a height of 25 m for 2.5", tape(metres=25.0), 0, ("measure",), ("solve", "SCENE", "-v"), "room"),
    labels("truncated", "half of a file", put(LABELS, '{"roo'), 1, (LABELS, "is not valid JSON")),
    labels("wrong type", "a kind nobody knows", put(LABELS, '{"roof": "lid"}'), 1, (LABELS, "lid")),
    labels("wrong type", "a number for a kind", put(LABELS, '{"roof": 7}'), 1, (LABELS,)),
    truth("missing", "no gt_planes.json", gone(TRUTH), 0, ("reprojection IoU",)),
    truth("truncated", "half of the file", cut(TRUTH), 1, (TRUTH, "is not valid JSON")),
    truth("NaN", "a plane's offset", first_plane(d=float("nan")), 1, (TRUTH,)),
    truth("zero", "a normal", first_plane(normal=[0, 0, 0]), 1, (TRUTH,)),
    truth("huge", "an offset", first_plane(d=1e300), 1, (TRUTH,)),
    truth("mirrored", "a normal that points away", first_plane(normal=[0.0, 0.0, -1.0]), 0, ("floor (floor_0)", "17")),
    truth(
        "missing", "a plane that elements name", edited(TRUTH, lambda d: d["planes"].pop("floor")), 1, (TRUTH, "floor")
    ),
    colmap("missing", "no images.txt", gone(IMAGES), 1, ("is incomplete: no images as .bin or .txt",)),
    colmap("missing", "no cameras.txt", gone(CAMERAS), 1, ("is incomplete: no cameras as .bin or .txt",)),
    colmap(
        "missing",
        "the camera of an image",
        replaced(IMAGES, " 1 000001.jpg", " 9 000001.jpg"),
        3,
        (IMAGES, "line 7: no camera 9"),
    ),
    colmap(
        "truncated", "half of images.txt", cut(IMAGES), 1, (IMAGES, "announces 7 images and holds 3: it was cut off")
    ),
    colmap(
        "truncated",
        "four fifths of images.txt",
        cut(IMAGES, 0.8),
        3,
        (IMAGES, "announces 7 images and holds 6: it was cut off"),
    ),
    colmap("truncated", "nine tenths of cameras.txt", cut(CAMERAS, 0.9), 1, (CAMERAS, "is no camera")),
    colmap("truncated", "an empty images.txt", put(IMAGES, ""), 1, (IMAGES, "holds no image")),
)
