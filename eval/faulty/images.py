"""Faults of images, depth maps and videos."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from faulty.case import Case
from faulty.spoil import a_folder, cut, each_image, gone, nothing, pixels, put

case = partial(Case, "Images")
depth = partial(Case, "Depth maps", command=("evaluate", "SCENE"), room="solved")
VIDEO = "clip.avi"
FREE, ANNOTATED, DEPTH = "images/000001.jpg", "images/000003.jpg", "depth/000004.png"


def others_pictures(folder: Path) -> None:
    """The images stand in another order than their names."""
    paths = sorted((folder / "images").iterdir())
    contents = [path.read_bytes() for path in paths]
    for path, content in zip(paths, contents[::-1], strict=True):
        path.write_bytes(content)


def one_picture(folder: Path) -> None:
    """All images are the first one."""
    paths = sorted((folder / "images").iterdir())
    for path in paths[1:]:
        shutil.copyfile(paths[0], path)


def no_images(folder: Path) -> None:
    """An empty folder of images."""
    for path in (folder / "images").iterdir():
        path.unlink()


def video(share: float = 1.0, count: int = 7) -> Any:
    """The images as a video beside the scene, of which only a share of the bytes is there."""

    def spoil(folder: Path) -> None:
        path = folder / VIDEO
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 5, (96, 72))
        for image in sorted((folder / "images").iterdir())[:count]:
            picture = cv2.imread(str(image))
            assert picture is not None
            writer.write(picture)
        writer.release()
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])

    return spoil


def turned(image: Any) -> Any:
    """By a quarter."""
    return np.rot90(image)


def millimetres_as_metres(values: Any) -> Any:
    """As uint16: 2.4 m is 2."""
    return (values / 1000).astype(np.uint16)


IMPORT = ("import", "SCENE/" + VIDEO, "HERE/out")

CASES: tuple[Case, ...] = (
    case("missing", "one image", gone(FREE), 3, ("1 of 7 cameras have no image file and were skipped", FREE)),
    case("missing", "an annotated image", gone(ANNOTATED), 3, ("000003.jpg", "has no image file")),
    case("missing", "all images", no_images, 1, ("no image file",)),
    case("missing", "the folder of images", lambda f: shutil.rmtree(f / "images"), 1, ("no image file",)),
    case("missing", "a folder in an image's place", a_folder(FREE), 3, ("000001.jpg",)),
    case("truncated", "half of an image", cut(FREE), 3, (FREE, "damaged, or not an image; the frame is stepped over")),
    case("truncated", "half of an annotated image", cut(ANNOTATED), 3, (ANNOTATED, "it is annotated: mend it")),
    case("truncated", "half of an annotated image, solved", cut(ANNOTATED), 1, (ANNOTATED,), ("solve", "SCENE")),
    case(
        "truncated", "half of another image, solved", cut(FREE), 0, ("000001.jpg",), ("solve", "SCENE", "-v"), slow=True
    ),
    case("truncated", "an empty file", put(FREE, b""), 3, (FREE, "damaged, or not an image")),
    case("no such file", "text", put(FREE, "no picture"), 3, (FREE, "damaged, or not an image")),
    case("zero", "a black image", pixels(ANNOTATED, lambda i: 0 * i), 3, ("000003.jpg: annotated, but nearly black",)),
    case("zero", "all images are black", each_image(lambda i: 0 * i), 3, ("nearly black",)),
    case(
        "all tracks lost",
        "all images are black",
        each_image(lambda i: 0 * i),
        1,
        ("no point could be tracked",),
        ("solve", "SCENE"),
    ),
    case(
        "all tracks lost",
        "noise for images",
        each_image(lambda i: np.random.default_rng(int(i.sum())).integers(0, 255, i.shape, np.uint8)),
        3,
        ("points could be followed",),
    ),
    case(
        "all tracks lost",
        "noise for images, solved",
        each_image(lambda i: np.random.default_rng(int(i.sum())).integers(0, 255, i.shape, np.uint8)),
        1,
        ("tracked",),
        ("solve", "SCENE"),
    ),
    case(
        "huge",
        "all images are four times as large",
        each_image(lambda i: cv2.resize(i, None, fx=4, fy=4)),
        3,
        ("were scaled",),
        slow=True,
    ),
    case("duplicated", "all images are one picture", one_picture, 3, ("7 files hold the same picture",)),
    case(
        "duplicated",
        "all images are one picture, solved",
        one_picture,
        0,
        ("REDO: depth is known to 10 % for only 0 %",),
        ("solve", "SCENE"),
    ),
    case(
        "out of order", "pictures under one another's names", others_pictures, 3, ("the cameras do not fit the images",)
    ),
    case("wrong axes", "one image is turned by 90°", pixels(FREE, turned), 3, ("000001.jpg",)),
    case("wrong axes", "all images are turned by 90°", each_image(turned), 1, ("another shape",)),
    case(
        "wrong axes",
        "all images are upside down",
        each_image(lambda i: i[::-1, ::-1]),
        3,
        ("the cameras fit the images only with images that are upside down",),
    ),
    case(
        "mirrored",
        "all images",
        each_image(lambda i: i[:, ::-1]),
        3,
        ("the cameras fit the images only with images that are mirrored",),
    ),
    case("swapped", "red and blue", each_image(lambda i: i[..., ::-1]), 3, ("7 frames",), silent=("cannot read",)),
    case("swapped", "grey images", each_image(lambda i: i[..., 1]), 3, ("7 frames",), silent=("cannot read",)),
    depth("missing", "one map", gone(DEPTH), 0, ("depth error",)),
    depth("missing", "all maps", lambda f: shutil.rmtree(f / "depth"), 0, ("IoU",)),
    depth("truncated", "half of a map", cut(DEPTH), 1, (DEPTH,)),
    depth("truncated", "an empty file", put(DEPTH, b""), 1, (DEPTH,)),
    depth("zero", "no depth anywhere", pixels(DEPTH, lambda i: 0 * i), 0, ("depth error",)),
    depth("huge", "65 m everywhere", pixels(DEPTH, lambda i: i * 0 + 65535), 0, ("depth error",)),
    depth("wrong type", "eight bits", pixels(DEPTH, lambda i: (i >> 8).astype(np.uint8)), 1, (DEPTH,)),
    depth("wrong type", "three channels", pixels(DEPTH, lambda i: np.dstack([i, i, i])), 1, (DEPTH,)),
    depth("wrong axes", "turned by 90°", pixels(DEPTH, turned), 1, (DEPTH,)),
    depth(
        "wrong unit",
        "metres for millimetres",
        pixels(DEPTH, millimetres_as_metres),
        3,
        ("depth",),
        command=("check", "SCENE"),
    ),
)
VIDEOS = partial(Case, "Videos", command=IMPORT)
CASES += (
    VIDEOS("missing", "no such video", nothing, 1, (VIDEO,)),
    VIDEOS("missing", "a video without cameras", video(), 1, (VIDEO,)),
    VIDEOS("truncated", "an empty file", put(VIDEO, b""), 1, (VIDEO,)),
    VIDEOS("truncated", "half of it", video(0.5), 1, (VIDEO,), command=(*IMPORT, "--colmap")),
    VIDEOS("no such file", "text", put(VIDEO, "no video" * 99), 1, (VIDEO,), command=(*IMPORT, "--colmap")),
    VIDEOS("one frame", "a video of one frame", video(count=1), 1, (VIDEO,), command=(*IMPORT, "--colmap")),
)
