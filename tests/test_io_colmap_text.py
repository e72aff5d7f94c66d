"""COLMAP's text files as other programs and editors leave them: every line costs at most itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scene_checks import assert_one_camera_skipped

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.colmap.reader import open_model, read_colmap
from gtlayout.io.sources import PosedImages

CAMERAS = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 PINHOLE 64 48 60 61 32 24\n"
NAMES = [f"{i:03d}.png" for i in range(5)]
POINTS = "10.5 20.5 -1 11 21 7"
Lines = list[str]


def lines_of(names: Lines, points: str | None = "") -> Lines:
    """Two lines an image, or one where ``points`` is None."""
    lines = []
    for i, name in enumerate(names):
        lines += [f"{i + 1} 0.8 0 0.6 0 {0.1 * i} 0.25 -3 1 {name}", *([] if points is None else [points])]
    return lines


def read(root: Path, images: str | bytes, cameras: str | bytes = CAMERAS) -> PosedImages:
    for name, content in (("cameras", cameras), ("images", images), ("points3D", "")):
        (root / f"{name}.txt").write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_colmap(root, root)


def assert_whole(found: PosedImages, names: Lines) -> None:
    assert found.warnings == ()
    assert [image.name for image in found.images] == names
    for i, image in enumerate(found.images):
        np.testing.assert_allclose(image.t_cam_from_world, [0.1 * i, 0.25, -3])
        turned = np.array([[0.28, 0, 0.96], [0, 1, 0], [-0.96, 0, 0.28]])
        np.testing.assert_allclose(image.R_cam_from_world, turned, atol=1e-15)
        assert list(image.camera.params) == [60, 61, 32, 24]


@pytest.mark.parametrize(
    "names",
    [
        NAMES,
        ["scan (0).jpg", "scan (1).jpg", "a  b.jpg"],
        ["A-DJI_2 (402).jpg", "1 2 3.jpg", "100 200"],
        ["left/a 1.png", "left/a 2.png"],
    ],
)
@pytest.mark.parametrize("points", ["", POINTS, None])
def test_names_and_second_lines(tmp_path: Path, names: Lines, points: str | None) -> None:
    if points is None and "100 200" in names:
        pytest.skip("a name of numbers only, after a missing line, cannot be told from points")
    assert_whole(read(tmp_path, "\n".join(lines_of(names, points)) + "\n"), names)


def _between(lines: Lines, extra: str) -> str:
    """A line before, and after each second line."""
    return "\n".join([extra, *(each for i in range(0, len(lines), 2) for each in (lines[i], lines[i + 1], extra))])


@pytest.mark.parametrize(
    "text",
    [
        _between(lines_of(NAMES), ""),
        _between(lines_of(NAMES, POINTS), "  # a comment"),
        "\r\n".join(lines_of(NAMES)),
        "\r\n".join(lines_of(NAMES, POINTS)) + "\r\n",
        "﻿" + "\n".join(lines_of(NAMES)),
        "﻿# a comment\n" + "\n".join(lines_of(NAMES)),
        "\n".join(f"  {line}  " for line in lines_of(NAMES, POINTS)),
        "\n".join(lines_of(NAMES, POINTS)[:-1]),
    ],
)
def test_editors(tmp_path: Path, text: str) -> None:
    assert_whole(read(tmp_path, text, "﻿" + CAMERAS.replace("\n", "\r\n")), NAMES)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda lines: lines.__setitem__(4, "3 1 0 0 0 0 0 0 1"), r"images\.txt, line 5 is no image"),
        (lambda lines: lines.__setitem__(4, lines[4].replace("0.8", "x")), r"images\.txt, line 5 is no image"),
        (lambda lines: lines.__setitem__(4, lines[4].replace("0.8", "nan")), r"images\.txt, line 5 is no image"),
        (lambda lines: lines.__setitem__(4, lines[4].replace("0.8 0 0.6 0", "0 0 0 0")), "quaternion is of length 0"),
        (
            lambda lines: lines.__setitem__(4, lines[4].replace(" 1 00", " 9 00")),
            "line 5: no camera 9 in .*cameras.txt",
        ),
        (lambda lines: lines.__setitem__(4, lines[4].replace(" 1 00", " 2 00")), r"cameras\.txt, line 3 is no camera"),
        (lambda lines: lines.__setitem__(4, lines[4].replace(" 1 00", " 3 00")), r"cameras\.txt, line 4 is no camera"),
        (
            lambda lines: lines.__setitem__(4, lines[4].replace(" 1 00", " 4 00")),
            "camera 4 has no valid size and focal",
        ),
        (
            lambda lines: lines.__setitem__(4, lines[4].replace("002.png", "../002.png")),
            "leads out of the scene folder",
        ),
        (lambda lines: lines.__setitem__(4, lines[4].replace("002.png", "/etc/2.png")), "must be relative"),
        (lambda lines: lines.__setitem__(4, lines[4].replace("-3", "1e999")), r"images\.txt, line 5 is no image"),
    ],
)
def test_a_bad_line_costs_itself(tmp_path: Path, change: Callable[[Lines], object], says: str) -> None:
    lines = lines_of(NAMES, POINTS)
    change(lines)
    more = "2 PINHOLE 64\n3 NO_SUCH 64 48 1\n4 PINHOLE 64 48 -1 60 32 24\nrubbish\n"
    found = read(tmp_path, "\n".join(lines), CAMERAS + more)
    assert [image.name for image in found.images] == [name for name in NAMES if name != "002.png"]
    assert_one_camera_skipped(found.warnings, rf"1 of 5 .*{says}")


def test_a_name_that_is_no_text_costs_itself(tmp_path: Path) -> None:
    text = "\n".join(lines_of(NAMES)).encode().replace(b"002.png", b"K\xfcche.png")
    found = read(tmp_path, text)
    assert len(found.images) == 4
    assert_one_camera_skipped(found.warnings, "characters that no name has")


@pytest.mark.parametrize("text", ["", "# nothing\n\n", "\n\n"])
def test_no_image(tmp_path: Path, text: str) -> None:
    with pytest.raises(GtlayoutError, match=r"images\.txt holds no image with a pose"):
        read(tmp_path, text)


def test_pycolmaps_own_reader_gets_the_names(tmp_path: Path) -> None:
    """It ends them at the first blank; depth maps are looked for by them."""
    names = ["scan (0).jpg", "scan (1).jpg"]
    read(tmp_path, "\n".join(lines_of(names)) + "\n")
    assert sorted(image.name for image in open_model(tmp_path).images.values()) == names
