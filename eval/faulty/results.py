"""Faults of what was solved: ``layout.json`` and the files beside it."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from faulty.case import Case, Spoil
from faulty.spoil import a_folder, all_of, cut, edited, gone, put

LAYOUT = "gtlayout/layout.json"
case = partial(Case, "Results (layout.json)", room="solved")
EVALUATE, REPORT, EXPORT = ("evaluate", "SCENE"), ("report", "SCENE"), ("export", "SCENE", "--to", "glb")


def plane(**values: Any) -> Spoil:
    """The first instance's plane, with other values."""
    return edited(LAYOUT, lambda data: data["instances"][0]["plane"].update(values))


def extent(change: Any) -> Spoil:
    """The first instance's extent."""
    return edited(LAYOUT, lambda data: change(data["instances"][0]["extent"]))


CASES = (
    case("missing", "the scene was never solved", gone(LAYOUT), 1, (LAYOUT, "solve the scene first"), EVALUATE),
    case("missing", "the scene was never solved: report", gone(LAYOUT), 1, (LAYOUT, "solve the scene first"), REPORT),
    case("missing", "the scene was never solved: export", gone(LAYOUT), 1, (LAYOUT, "solve the scene first"), EXPORT),
    case(
        "missing",
        "instances",
        edited(LAYOUT, lambda d: d.pop("instances")),
        1,
        (LAYOUT, "is damaged", "solve the scene again"),
        EVALUATE,
    ),
    case(
        "missing",
        "the mesh",
        edited(LAYOUT, lambda d: d.pop("mesh")),
        1,
        (LAYOUT, "is damaged", "solve the scene again"),
        EXPORT,
    ),
    case("missing", "quality.json: report", gone("gtlayout/quality.json"), 0, ("Report:",), REPORT),
    case("missing", "config.json: report", gone("gtlayout/config.json"), 0, ("Report:",), REPORT),
    case("missing", "evidence.json: report", gone("gtlayout/evidence.json"), 0, ("Report:",), REPORT),
    case("missing", "timings.json: report", gone("gtlayout/timings.json"), 0, ("Report:",), REPORT),
    case(
        "missing",
        "an element that was solved",
        edited("annotations.json", lambda d: d["frames"][0]["elements"].pop(0)),
        1,
        (LAYOUT, "was made from other annotations", "solve the scene again"),
        EVALUATE,
    ),
    case("truncated", "half of the file", cut(LAYOUT), 1, (LAYOUT, "is not valid JSON"), EVALUATE),
    case("truncated", "half of the file: export", cut(LAYOUT), 1, (LAYOUT, "is not valid JSON"), EXPORT),
    case("truncated", "half of quality.json: report", cut("gtlayout/quality.json"), 1, ("quality.json",), REPORT),
    case("truncated", "half of evidence.json: report", cut("gtlayout/evidence.json"), 1, ("evidence.json",), REPORT),
    case("truncated", "an empty file", put(LAYOUT, b""), 1, (LAYOUT,), REPORT),
    case("no such file", "JSON of something else", put(LAYOUT, "{}"), 1, (LAYOUT, "is not a layout"), EVALUATE),
    case("no such file", "a folder in its place", all_of(gone(LAYOUT), a_folder(LAYOUT)), 1, (LAYOUT,), EVALUATE),
    case("NaN", "a normal", plane(normal=[np.nan, 0, 1]), 1, (LAYOUT, "is damaged"), EVALUATE),
    case(
        "NaN",
        "a point of the extent",
        extent(lambda e: e["polygons"][0][0][0].__setitem__(0, np.nan)),
        1,
        (LAYOUT,),
        EXPORT,
    ),
    case("infinite", "an offset", plane(d=np.inf), 1, (LAYOUT, "is damaged"), EVALUATE),
    case("zero", "a normal", plane(normal=[0.0, 0, 0]), 1, (LAYOUT, "is damaged"), EVALUATE),
    case("huge", "a normal", plane(normal=[1e9, 0, 0]), 1, (LAYOUT, "is damaged"), EVALUATE),
    case("huge", "an offset", plane(d=1e300), 1, (LAYOUT, "is damaged"), EVALUATE),
    case("negative", "a variance", plane(covariance=(-np.eye(4)).tolist()), 1, (LAYOUT, "is damaged"), EVALUATE),
    case(
        "wrong type",
        "a covariance of three rows",
        plane(covariance=np.eye(3).tolist()),
        1,
        (LAYOUT, "is damaged"),
        EVALUATE,
    ),
    case(
        "wrong type",
        "a label nobody knows",
        edited(LAYOUT, lambda d: d["instances"][0].update(label="lid")),
        1,
        (LAYOUT, "is damaged"),
        EVALUATE,
    ),
    case(
        "duplicated",
        "two instances with one name",
        edited(LAYOUT, lambda d: d["instances"][1].update(name=d["instances"][0]["name"])),
        1,
        (LAYOUT, "is damaged"),
        EVALUATE,
    ),
    case(
        "duplicated",
        "an element of two instances",
        edited(LAYOUT, lambda d: d["instances"][1]["members"].append(d["instances"][0]["members"][0])),
        1,
        ("the layout was made from other annotations; solve the scene again",),
        EVALUATE,
    ),
    case(
        "out of order",
        "instances",
        edited(LAYOUT, lambda d: d["instances"].reverse()),
        0,
        ("reprojection IoU",),
        EVALUATE,
    ),
    case(
        "swapped",
        "a face of the mesh with no such vertex",
        edited(LAYOUT, lambda d: d["mesh"]["faces"][0].__setitem__(0, 10**6)),
        1,
        (LAYOUT, "is damaged"),
        EXPORT,
    ),
    case(
        "missing",
        "a host that is not there",
        edited(LAYOUT, lambda d: d["instances"][-1].update(host="wall_77")),
        1,
        (LAYOUT, "is damaged"),
        EVALUATE,
    ),
)
