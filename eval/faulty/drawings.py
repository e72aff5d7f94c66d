"""Faults of drawings, in ``annotations.json``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from faulty.case import Case, Spoil
from faulty.spoil import Change, a_folder, cut, edited, gone, put

FILE = "annotations.json"
case = partial(Case, "Annotations")
SOLVE = ("solve", "SCENE", "-v")
FIRST = "000000.jpg, element e0"
BOX = [[10.0, 10.0], [40.0, 10.0], [40.0, 40.0], [10.0, 40.0]]


def drawings(change: Change) -> Spoil:
    """``annotations.json``, changed."""
    return edited(FILE, change)


def first(change: Change) -> Spoil:
    """The first element of the first frame."""
    return drawings(lambda data: change(data["frames"][0]["elements"][0]))


def frame(change: Change) -> Spoil:
    """The first frame."""
    return drawings(lambda data: change(data["frames"][0]))


def each(change: Change) -> Spoil:
    """Every element."""

    def spoil(data: Any) -> None:
        for one in data["frames"]:
            for element in one["elements"]:
                change(element)

    return drawings(spoil)


def polygons(change: Callable[[Any], Any]) -> Spoil:
    """Every ring of every element, (N, 2) px."""

    def spoil(element: Any) -> None:
        for name in ("polygons", "visible"):
            element[name] = [change(np.array(ring)).tolist() for ring in element.get(name, [])]

    return each(spoil)


def vertex(value: float) -> Spoil:
    """One coordinate of one vertex."""
    return first(lambda e: e["polygons"][0][0].__setitem__(0, value))


def ring(points: Any) -> Spoil:
    """Another outline of the first element."""
    return first(lambda e: e.update(polygons=[points]))


def labels_swapped(data: Any) -> None:
    """Floor for ceiling in one frame."""
    other = {"floor": "ceiling", "ceiling": "floor"}
    for element in data["frames"][1]["elements"]:
        element["label"] = other.get(element["label"], element["label"])


def frames_swapped(data: Any) -> None:
    """The drawings of two images stand under one another's names."""
    a, b = data["frames"][0], data["frames"][2]
    a["image"], b["image"] = b["image"], a["image"]


def only(count: int, label: str | None = None) -> Change:
    """As many elements in each frame, of one label."""

    def change(data: Any) -> None:
        for one in data["frames"]:
            one["elements"] = [e for e in one["elements"] if label in (None, e["label"])][:count]

    return change


def one_element(data: Any) -> None:
    """Nothing but one wall in one frame."""
    only(1, "wall")(data)
    data["frames"] = data["frames"][:1]


def over_the_horizon(element: Any) -> None:
    """Floors drawn to the top of the image."""
    if element["label"] == "floor":
        element["polygons"] = [[[0.0, 0.0], [160.0, 0.0], [160.0, 120.0], [0.0, 120.0]]]


CASES = (
    case("missing", "no annotations", gone(FILE), 1, ("no annotations",)),
    case("missing", "a folder in their place", a_folder(FILE), 1, (FILE,)),
    case("missing", "no frames in them", drawings(lambda d: d.update(frames=[])), 1, (FILE,)),
    case("missing", "frames without an element", drawings(only(0)), 1, (FILE,)),
    case("missing", "one frame without an element", frame(lambda f: f.update(elements=[])), 3, ("key frame(s) only",)),
    case(
        "missing",
        "an element has no label",
        first(lambda e: e.pop("label")),
        3,
        ("element skipped: it has no label", "first in 000000.jpg, element number 0"),
    ),
    case(
        "missing",
        "an element has no outline",
        first(lambda e: e.pop("polygons")),
        3,
        ("element skipped: it has no polygon", "first in 000000.jpg, element number 0"),
    ),
    case(
        "missing",
        "a frame does not name its image",
        frame(lambda f: f.pop("image")),
        3,
        ("frame skipped: it has no image name",),
    ),
    case("missing", "the image that is named", frame(lambda f: f.update(image="x.jpg")), 3, ("x.jpg",)),
    case("truncated", "half of the file", cut(FILE), 1, (FILE, "is not valid JSON")),
    case("truncated", "an empty file", put(FILE, b""), 1, (FILE,)),
    case("no such file", "bytes that are no text", put(FILE, bytes(range(256))), 1, (FILE,)),
    case("no such file", "JSON of something else", put(FILE, '{"a": 1}'), 1, (FILE,)),
    case("NaN", "one vertex", vertex(np.nan), 3, ("no pairs of finite numbers", FIRST)),
    case("infinite", "one vertex", vertex(np.inf), 3, ("no pairs of finite numbers", FIRST)),
    case("huge", "one vertex at 10^9 px", vertex(1e9), 3, ("no pairs of finite numbers", FIRST)),
    case("huge", "one vertex at 10^300 px", vertex(1e300), 3, (FIRST,)),
    case(
        "negative",
        "an element outside of the image",
        ring([[x - 500, y] for x, y in BOX]),
        3,
        (FIRST, "no polygon left within the image"),
    ),
    case("zero", "an outline without area", ring([BOX[0], BOX[0], BOX[0]]), 3, (FIRST,)),
    case("zero", "a straight line", ring([[1.0, 1], [50, 50], [90, 90]]), 3, (FIRST,)),
    case("zero", "an outline of two points", ring(BOX[:2]), 3, (FIRST,)),
    case("wrong type", "text for a number", first(lambda e: e["polygons"][0][0].__setitem__(0, "x")), 3, (FIRST,)),
    case("wrong type", "a label nobody knows", first(lambda e: e.update(label="roof")), 3, ("roof",)),
    case("wrong type", "an outline that crosses itself", ring([BOX[0], BOX[2], BOX[1], BOX[3]]), 3, ("000000.jpg",)),
    case(
        "duplicated",
        "two elements with one id",
        frame(lambda f: f["elements"][1].update(id="e0")),
        3,
        ("000000.jpg", "e0"),
    ),
    case(
        "duplicated",
        "an element drawn twice",
        frame(lambda f: f["elements"].append(f["elements"][2] | {"id": "again"})),
        3,
        ("000000.jpg: wall again left out: almost the same polygon as wall e2",),
    ),
    case(
        "duplicated",
        "an image annotated twice",
        drawings(lambda d: d["frames"].append(d["frames"][0])),
        3,
        ("000000.jpg",),
    ),
    case(
        "duplicated",
        "a ring with every vertex twice",
        polygons(lambda r: np.repeat(r, 2, axis=0)),
        0,
        ("nothing suspicious",),
    ),
    case("out of order", "frames", drawings(lambda d: d["frames"].reverse()), 0, ("nothing suspicious",)),
    case("out of order", "rings run the other way round", polygons(lambda r: r[::-1]), 0, ("nothing suspicious",)),
    case(
        "wrong unit",
        "coordinates from 0 to 1",
        polygons(lambda r: r / [96, 72]),
        1,
        (FILE, "all its coordinates lie between 0 and 1"),
    ),
    case(
        "wrong unit",
        "drawn on images twice as large, which is said",
        drawings(lambda d: d.update(image_size=[48, 36])),
        3,
        ("annotated in another size",),
    ),
    case("wrong axes", "x and y swapped", polygons(lambda r: r[:, ::-1]), 3, ("000000.jpg",)),
    case(
        "wrong axes",
        "x and y swapped, solved",
        polygons(lambda r: r[:, ::-1]),
        0,
        ("REDO: IoU",),
        SOLVE,
        "room",
        slow=True,
    ),
    case(
        "mirrored",
        "all drawings",
        polygons(lambda r: [160, 0] + [-1, 1] * r),
        0,
        ("REDO: IoU",),
        SOLVE,
        "room",
        slow=True,
    ),
    case(
        "wrong axes",
        "all drawings upside down",
        polygons(lambda r: [0, 72] + [1, -1] * r),
        3,
        ("000000.jpg: floor e4 lies above ceiling e3", "turn image and drawing"),
    ),
    case(
        "swapped",
        "floor and ceiling in one frame",
        drawings(labels_swapped),
        3,
        ("000003.jpg: floor", "lies above ceiling", "swap their labels"),
    ),
    case(
        "swapped",
        "floor and ceiling in one frame, solved",
        drawings(labels_swapped),
        0,
        ("CHECK: floor_1, ceiling_1 are unobservable",),
        SOLVE,
        "room",
        slow=True,
    ),
    case(
        "swapped", "the drawings of two images", drawings(frames_swapped), 0, ("REDO: IoU",), SOLVE, "room", slow=True
    ),
    case(
        "swapped",
        "all labels are wall",
        each(lambda e: e.update(label="wall")),
        0,
        ("REDO: IoU", "are unobservable"),
        SOLVE,
        "room",
        slow=True,
    ),
    case(
        "one frame",
        "one annotated frame",
        drawings(lambda d: d.update(frames=d["frames"][:1])),
        0,
        ("CHECK", "only 1 of 7 instances", "predicted doubtful"),
        SOLVE,
        "room",
    ),
    case(
        "one element",
        "one wall in one frame",
        drawings(one_element),
        0,
        ("REDO: depth is known to 10 %", "no instance is ok"),
        SOLVE,
        "room",
    ),
    case(
        "one element",
        "one floor in each frame",
        drawings(only(1, "floor")),
        0,
        ("CHECK", "no instance is ok", "predicted doubtful"),
        SOLVE,
        "room",
    ),
    case(
        "one element",
        "one ceiling in each frame",
        drawings(only(1, "ceiling")),
        0,
        ("CHECK", "no instance is ok", "predicted doubtful"),
        SOLVE,
        "room",
        slow=True,
    ),
    case(
        "no visible parts",
        "in any element",
        each(lambda e: e.pop("visible", None)),
        0,
        ("CHECK", "no visible parts drawn"),
        SOLVE,
        "room",
        slow=True,
    ),
    case(
        "no visible parts",
        "outside of the element",
        first(lambda e: e.update(visible=[[[0, 0], [9, 0], [9, 9]]])),
        3,
        ("e0",),
    ),
    case(
        "no visible parts",
        "all visible parts in one corner",
        each(lambda e: e.update(visible=[[[0, 0], [9, 0], [9, 9]]])),
        0,
        ("REDO: IoU", "floor_0 is unobservable"),
        SOLVE,
        "room",
        slow=True,
    ),
    case(
        "across the horizon",
        "floors drawn to the top of the image",
        each(over_the_horizon),
        0,
        ("CHECK: floor_0 is out of all proportion",),
        SOLVE,
        "room",
    ),
    case(
        "huge",
        "1001 elements in one frame",
        frame(lambda f: f.update(elements=[f["elements"][0] | {"id": str(i)} for i in range(1001)])),
        3,
        ("000000.jpg skipped: more than 1,000 elements in one frame",),
    ),
)
