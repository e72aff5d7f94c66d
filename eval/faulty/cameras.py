"""Faults of cameras: nerfstudio's ``transforms.json`` and the text of a COLMAP model."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from faulty.case import Case, Spoil
from faulty.spoil import Change, a_folder, cut, edited, gone, put, replaced

FILE = "transforms.json"
case = partial(Case, "Cameras")


def cameras(change: Change) -> Spoil:
    """``transforms.json``, changed."""
    return edited(FILE, change)


def pose(index: int, change: Callable[[Any], Any]) -> Spoil:
    """One pose (4, 4) world from camera, OpenGL's axes."""

    def put_pose(data: Any) -> None:
        frame = data["frames"][index]
        frame["transform_matrix"] = change(np.array(frame["transform_matrix"])).tolist()

    return cameras(put_pose)


def poses(change: Callable[[int, Any], Any]) -> Spoil:
    """All of them, by their number."""

    def put_poses(data: Any) -> None:
        for i, frame in enumerate(data["frames"]):
            frame["transform_matrix"] = change(i, np.array(frame["transform_matrix"])).tolist()

    return cameras(put_poses)


def entry(row: int, column: int, value: float) -> Callable[[Any], Any]:
    """A pose with another entry."""

    def change(matrix: Any) -> Any:
        matrix[row, column] = value
        return matrix

    return change


def key(**values: Any) -> Spoil:
    """Keys that hold for all frames."""
    return cameras(lambda data: data.update(values))


def moved(scale: float, shift: float = 0.0) -> Spoil:
    """In another unit, or with another origin."""

    def change(_: int, matrix: Any) -> Any:
        matrix[:3, 3] = scale * matrix[:3, 3] + shift
        return matrix

    return poses(change)


def single(shift: float) -> Spoil:
    """Positions off by ``shift``, in numbers of 32 bits."""

    def change(_: int, matrix: Any) -> Any:
        matrix[:3, 3] = np.float32(matrix[:3, 3] + shift)
        return matrix

    return poses(change)


def names_rotated(data: Any) -> None:
    """Each pose stands with another image."""
    names = [frame["file_path"] for frame in data["frames"]]
    for frame, name in zip(data["frames"], names[3:] + names[:3], strict=True):
        frame["file_path"] = name


GL = np.diag([1.0, -1, -1, 1])
MIRROR = np.diag([-1.0, 1, 1, 1])
ONE_SKIPPED = "1 of 7 cameras cannot be used and were skipped"

CASES = (
    case("missing", "no file of cameras", gone(FILE), 1, ("no cameras",)),
    case("missing", "a folder in its place", a_folder(FILE), 1, (FILE,)),
    case(
        "missing", "a pose has no matrix", cameras(lambda d: d["frames"][1].pop("transform_matrix")), 3, ("000001.jpg",)
    ),
    case("missing", "a frame has no name", cameras(lambda d: d["frames"][1].pop("file_path")), 3, ("file_path",)),
    case("missing", "no focal length", cameras(lambda d: (d.pop("fl_x"), d.pop("fl_y"))), 1, (FILE, "fl_x")),
    case("missing", "no frames", key(frames=[]), 1, (FILE,)),
    case("missing", "no list of frames", cameras(lambda d: d.pop("frames")), 1, (FILE,)),
    case("missing", "an image's camera", cameras(lambda d: d["frames"].pop(1)), 0, ("nothing suspicious: 6 frames",)),
    case("missing", "an annotated image's camera", cameras(lambda d: d["frames"].pop(3)), 3, ("000003.jpg",)),
    case("truncated", "half of the file", cut(FILE), 1, (FILE, "is not valid JSON")),
    case("truncated", "an empty file", put(FILE, b""), 1, (FILE,)),
    case("truncated", "the matrix has three columns", pose(1, lambda m: m[:, :3]), 3, (ONE_SKIPPED,)),
    case("no such file", "bytes that are no text", put(FILE, bytes(range(256))), 1, (FILE,)),
    case("no such file", "a list", put(FILE, "[1, 2]"), 1, (FILE, "must hold a JSON object")),
    case("NaN", "one entry of a pose", pose(1, entry(0, 3, np.nan)), 3, (ONE_SKIPPED, "000001.jpg")),
    case("NaN", "all poses", poses(lambda _, m: m * np.nan), 1, (FILE,)),
    case("NaN", "the focal length", key(fl_x=np.nan), 1, (FILE,)),
    case("infinite", "one entry of a pose", pose(1, entry(0, 3, np.inf)), 3, (ONE_SKIPPED, "000001.jpg")),
    case("infinite", "the principal point", key(cx=np.inf), 1, (FILE,)),
    case("zero", "one pose", pose(1, lambda m: 0 * m), 3, (ONE_SKIPPED, "000001.jpg")),
    case("zero", "the focal length", key(fl_x=0.0, fl_y=0.0), 1, (FILE,)),
    case("zero", "the image's width", key(w=0), 1, (FILE,)),
    case("negative", "the focal length", key(fl_y=-60.0), 1, (FILE,)),
    case("negative", "the image's height", key(h=-72), 1, (FILE,)),
    case("huge", "the focal length", key(fl_x=1e9, fl_y=1e9), 1, (FILE, "no valid size and focal length")),
    case("huge", "the principal point", key(cx=1e9), 1, (FILE, "the principal point", "lies outside of images")),
    case("huge", "the image's width", key(w=10**9), 1, (FILE,)),
    case("huge", "a whole number of 400 digits", replaced(FILE, '"cx": 48.0', '"cx": 1' + 400 * "0"), 1, (FILE,)),
    case("huge", "one position at 10^13", pose(1, entry(0, 3, 1e13)), 3, (ONE_SKIPPED, "000001.jpg")),
    case(
        "huge",
        "one position at 10^6",
        pose(1, entry(0, 3, 1e6)),
        3,
        ("1 of 7 cameras are elsewhere and were skipped", "000001.jpg: 1e+06 from the middle of the others"),
        silent=("timestamps",),
    ),
    case(
        "huge",
        "one position at 10^300",
        pose(1, entry(0, 3, 1e300)),
        3,
        (ONE_SKIPPED, "000001.jpg", "translation cannot be one"),
    ),
    case("huge", "all positions off by 10^8", moved(1, 1e8), 0, ("nothing suspicious",)),
    case(
        "huge",
        "numbers of 32 bits, 10^5 from the origin",
        single(1e5),
        3,
        ("camera positions come in steps of 0.0078", "numbers of 32 bits", "move the origin"),
    ),
    case("huge", "numbers of 32 bits, 10^8 from the origin", single(1e8), 3, ("camera positions come in steps of 8",)),
    case(
        "huge",
        "the distortion",
        key(camera_model="OPENCV", k1=1e6),
        1,
        ("000000.jpg", "the distortion of its lens", "correct the coefficients"),
    ),
    case(
        "duplicated",
        "one frame, the same twice",
        cameras(lambda d: d["frames"].append(d["frames"][1])),
        3,
        ("000001.jpg",),
    ),
    case(
        "duplicated",
        "one image with two poses",
        cameras(
            lambda d: d["frames"].append(d["frames"][1] | {"transform_matrix": d["frames"][5]["transform_matrix"]})
        ),
        3,
        ("2 cameras that differ for one image, 000001.jpg: it was left out",),
    ),
    case(
        "duplicated",
        "all frames have one pose",
        poses(lambda i, m: np.eye(4)),
        3,
        ("the cameras do not fit the images",),
    ),
    case("out of order", "the list of frames", cameras(lambda d: d["frames"].reverse()), 0, ("nothing suspicious",)),
    case("out of order", "poses of other images", cameras(names_rotated), 3, ("the poses of",)),
    case("wrong unit", "millimetres as metres", moved(1000), 3, ("looks like millimetres",)),
    case("wrong unit", "kilometres as metres", moved(0.001), 3, ("no room is that size",)),
    case("wrong axes", "OpenCV's as OpenGL's", poses(lambda _, m: m @ GL), 3, ("camera axes of the other kind",)),
    case("wrong axes", "the matrices are transposed", poses(lambda _, m: m.T), 1, (FILE,)),
    case(
        "swapped", "the matrices are inverted", poses(lambda _, m: np.linalg.inv(m)), 3, ("poses the other way round",)
    ),
    case("swapped", "width and height", key(w=72, h=96, cx=36.0, cy=48.0), 1, ("another shape",)),
    case("swapped", "cx and cy", key(cx=36.0, cy=48.0), 3, ("principal point", "off")),
    case("mirrored", "one pose", pose(1, lambda m: m @ MIRROR), 3, (ONE_SKIPPED, "is mirrored, no rotation")),
    case("mirrored", "the world", poses(lambda _, m: MIRROR @ m), 1, (FILE, "is mirrored, no rotation")),
    case(
        "mirrored",
        "the world, and the cameras with it",
        poses(lambda _, m: MIRROR @ m @ MIRROR),
        3,
        ("the cameras fit the images only with images that are mirrored", "or poses in the axes of a mirrored world"),
    ),
    case("wrong type", "a word for a number", key(fl_x="wide"), 1, (FILE, "fl_x")),
    case("wrong type", "a scaled rotation", pose(1, lambda m: m @ np.diag([2.0, 2, 2, 1])), 3, (ONE_SKIPPED,)),
    case("wrong type", "a last row that is none", pose(1, entry(3, 0, 1.0)), 3, (ONE_SKIPPED,)),
    case("wrong type", "a camera model nobody knows", key(camera_model="WIDE"), 1, (FILE, "WIDE")),
    case(
        "leads out",
        "a name outside the scene",
        cameras(lambda d: d["frames"][1].update(file_path="../x.jpg")),
        3,
        ("leads out",),
    ),
    case(
        "leads out",
        "an absolute name",
        cameras(lambda d: d["frames"][1].update(file_path="/etc/passwd")),
        3,
        ("relative",),
    ),
    case(
        "leads out",
        "a name with a line break",
        cameras(lambda d: d["frames"][1].update(file_path="a\nb.jpg")),
        3,
        ("characters",),
    ),
    case(
        "leads out",
        "a name of 5000 signs",
        cameras(lambda d: d["frames"][1].update(file_path="a" * 5000)),
        3,
        ("too long",),
    ),
    case(
        "one frame",
        "only one camera",
        cameras(lambda d: d.update(frames=d["frames"][:1])),
        1,
        ("at least 3 are needed",),
    ),
    case(
        "one frame",
        "only two cameras",
        cameras(lambda d: d.update(frames=d["frames"][:2])),
        1,
        ("at least 3 are needed",),
    ),
)
