"""Faults of what the cameras see: scenes that are read without a word, and cannot be solved, or not well."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from faulty.cameras import GL, MIRROR, cameras, entry, moved, names_rotated, pose, poses, single
from faulty.case import Case
from faulty.drawings import drawings, each
from faulty.spoil import nothing

case = partial(Case, "Geometry", command=("solve", "SCENE", "-v"), room="room")
check = partial(Case, "Geometry")


def two_labels(*labels: str) -> Any:
    """Nothing but elements of these labels."""

    def change(data: Any) -> None:
        for one in data["frames"]:
            one["elements"] = [e for e in one["elements"] if e["label"] in labels]

    return drawings(change)


def one_place(_: int, matrix: Any) -> Any:
    """The camera turns as it did, and stays where it is."""
    matrix[:3, 3] = 1.0
    return matrix


def nearly_one_place(i: int, matrix: Any) -> Any:
    """… within a micrometre."""
    matrix[:3, 3] = 1.0 + 1e-6 * np.sin(i)
    return matrix


def strips(element: Any) -> None:
    """Visible parts that are lines, 3 px high."""
    rings = np.array([point for ring in element["polygons"] for point in ring])
    (left, top), (right, bottom) = rings.min(axis=0), rings.max(axis=0)
    y = (top + bottom) / 2
    element["visible"] = [[[left, y - 1.5], [right, y - 1.5], [right, y + 1.5], [left, y + 1.5]]]


def sliver(element: Any) -> None:
    """A floor seen edge-on: two pixels high."""
    if element["label"] == "floor":
        element["polygons"] = [[[0.0, 80.0], [160.0, 80.0], [160.0, 82.0], [0.0, 82.0]]]
        element["visible"] = [[[0.0, 80.0], [160.0, 80.0], [160.0, 82.0], [0.0, 82.0]]]


def one_outline(element: Any) -> None:
    """Everything is drawn as the whole image."""
    element["polygons"] = [[[0.0, 0.0], [160.0, 0.0], [160.0, 120.0], [0.0, 120.0]]]


CASES = (
    case("camera in one place", "it only turns", poses(one_place), 1, ("the camera does not move",)),
    check("camera in one place", "it only turns, checked", poses(one_place), 3, ("the cameras do not fit the images",)),
    case("camera in one place", "it moves by a micrometre", poses(nearly_one_place), 1, ("the camera hardly moves",)),
    case(
        "camera in one place",
        "a camera that really only turns",
        nothing,
        1,
        ("the camera does not move", "all planes are unobservable"),
        room="turning",
    ),
    check(
        "camera in one place",
        "a camera that really only turns, checked",
        nothing,
        3,
        ("too little motion",),
        room="turning",
    ),
    case("wrong axes", "OpenCV's as OpenGL's", poses(lambda _, m: m @ GL), 1, ("the camera hardly moves",)),
    case(
        "swapped",
        "the matrices are inverted",
        poses(lambda _, m: np.linalg.inv(m)),
        0,
        ("REDO: depth is known to 10 % for only 0 %",),
        slow=True,
    ),
    case(
        "mirrored",
        "the world, and the cameras with it",
        poses(lambda _, m: MIRROR @ m @ MIRROR),
        0,
        ("REDO: depth is known to 10 % for only 0 %",),
        slow=True,
    ),
    case(
        "out of order",
        "poses of other images",
        cameras(names_rotated),
        0,
        ("REDO: depth is known to 10 % for only 0 %",),
        slow=True,
    ),
    case(
        "huge",
        "one position at 10^6",
        pose(1, entry(0, 3, 1e6)),
        0,
        ("1 of 9 cameras are elsewhere and were skipped", "000001.jpg"),
    ),
    case(
        "huge",
        "one position at 10^3",
        pose(1, entry(0, 3, 1e3)),
        0,
        ("1 of 9 cameras are elsewhere and were skipped",),
        slow=True,
    ),
    case(
        "huge",
        "numbers of 32 bits, 10^5 from the origin",
        single(1e5),
        0,
        ("CHECK", "camera positions come in steps of 0.0078"),
        slow=True,
    ),
    case(
        "huge",
        "numbers of 32 bits, 10^6 from the origin",
        single(1e6),
        0,
        ("REDO: depth is known to 10 % for only 0 %",),
    ),
    case(
        "huge",
        "numbers of 32 bits, 10^8 from the origin",
        single(1e8),
        1,
        ("the camera does not move", "gtlayout check"),
    ),
    case(
        "huge",
        "one position at 30, of a path of 0.2",
        pose(1, entry(0, 3, 30.0)),
        1,
        ("the camera hardly moves", "gtlayout check"),
    ),
    case(
        "huge",
        "an annotated position at 10^6",
        pose(4, entry(0, 3, 1e6)),
        0,
        ("1 of 9 cameras are elsewhere and were skipped", "000004.jpg"),
        slow=True,
    ),
    case(
        "huge",
        "all positions off by 10^8",
        moved(1, 1e8),
        0,
        ("TRUST: IoU 0.945", "0.078 m", "height floor_0 – ceiling_0: 2.416 ± 0.046 m"),
    ),
    case(
        "huge",
        "all positions off by 10^11",
        moved(1, 1e11),
        1,
        ("translation cannot be one", "more than 1e+09 from the origin"),
    ),
    case(
        "wrong unit",
        "millimetres as metres",
        moved(1000),
        0,
        ("CHECK: the scene counts as metric", "that looks like millimetres"),
        slow=True,
    ),
    case(
        "wrong unit",
        "micrometres as metres",
        moved(1e6),
        0,
        ("CHECK: the scene counts as metric", "no room is that size"),
    ),
    case(
        "wrong unit",
        "kilometres as metres",
        moved(0.001),
        0,
        ("CHECK: the scene counts as metric", "no room is that size"),
        slow=True,
    ),
    case(
        "wrong unit",
        "a thousand kilometres as metres",
        moved(1e-6),
        0,
        ("CHECK: the scene counts as metric", "no room is that size"),
        slow=True,
    ),
    case(
        "one plane",
        "nothing but the floor",
        two_labels("floor"),
        0,
        ("CHECK: floor_0 is out of all proportion", "no instance is ok"),
    ),
    case(
        "one plane",
        "floor and ceiling",
        two_labels("floor", "ceiling"),
        0,
        ("CHECK", "no instance is ok", "predicted doubtful"),
        slow=True,
    ),
    case(
        "one plane",
        "one wall with its door and window",
        two_labels("wall", "door", "window"),
        0,
        ("CHECK", "no instance is ok", "predicted doubtful"),
        slow=True,
    ),
    case(
        "one plane",
        "doors and windows without walls",
        two_labels("door", "window"),
        0,
        ("REDO: IoU", "are unobservable"),
        slow=True,
    ),
    case(
        "all tracks lost",
        "visible parts are lines",
        each(strips),
        0,
        ("CHECK", "no instance is ok", "predicted doubtful"),
        slow=True,
    ),
    case("grazing", "a floor seen edge-on", each(sliver), 0, ("REDO: IoU", "redraw floor_0")),
    case(
        "duplicated", "every element is the whole image", each(one_outline), 0, ("REDO: IoU", "almost the same polygon")
    ),
)
