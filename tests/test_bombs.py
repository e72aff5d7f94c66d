"""A few bytes that stand for gigabytes, and files that never end: refused in time and memory, by the command line."""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_formats import FORMATS, cameras_in_general_position

HUGE_BYTES = 5 << 30
MEMORY_BYTES = 1200 << 20
"""More than what is loaded already."""
CPU_S = 4.0
"""For one; reading 256 MB takes a tenth of it."""

CHILD = """
import contextlib, io, json, re, resource, sys, time
import gtlayout.api
from gtlayout.cli.app import main
from pathlib import Path

size = int(re.search(r"VmSize:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) << 10
resource.setrlimit(resource.RLIMIT_AS, (size + int(sys.argv[1]),) * 2)
found = {}
for name, folder in json.loads(sys.argv[2]).items():
    out, err, start = io.StringIO(), io.StringIO(), time.process_time()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(["check", folder])
    found[name] = [status, out.getvalue() + err.getvalue(), time.process_time() - start]
print(json.dumps(found))
"""


@dataclass(frozen=True)
class Answer:
    status: int
    text: str
    cpu_s: float


def endless(path: Path) -> None:
    path.unlink(missing_ok=True)
    path.symlink_to("/dev/zero")


def sparse(path: Path) -> None:
    """What it holds, and then nothing for long."""
    with path.open("r+b") as file:
        file.truncate(HUGE_BYTES)


def pipe(path: Path) -> None:
    path.unlink(missing_ok=True)
    os.mkfifo(path)


def content(data: bytes) -> Callable[[Path], None]:
    def put(path: Path) -> None:
        path.write_bytes(data)

    return put


def claims(suffix: str, find: bytes, put: bytes) -> Callable[[Path], None]:
    """An image of 64x48 px whose header says otherwise."""
    data = cv2.imencode(suffix, np.zeros((48, 64, 3), np.uint8))[1].tobytes()
    assert find in data
    return content(data.replace(find, put, 1))


def in_a_zip(path: Path) -> None:
    path.unlink()
    with (
        zipfile.ZipFile(path.with_name("drawn.zip"), "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("annotations.xml", "w", force_zip64=True) as member,
    ):
        for _ in range(300):
            member.write(bytes(1 << 20))


IMAGE = "images/002.png"
BOMBS: dict[str, tuple[str, Callable[[Path], None], str]] = {
    "endless image": (IMAGE, endless, "have no image file"),
    "huge image file": (IMAGE, sparse, "more than 256 MB: set GTLAYOUT_MAX_FILE_MB to read more"),
    "image that is a pipe": (IMAGE, pipe, "have no image file"),
    "bmp": (IMAGE, claims(".bmp", struct.pack("<ii", 64, 48), struct.pack("<ii", 30000, 30000)), "128 megapixels"),
    "webp": (
        IMAGE,
        content(b"RIFF\x00\x01\x00\x00WEBPVP8X\x0a\x00\x00\x00" + bytes(4) + b"\xff\x7f\x00" * 2),
        "002.png",
    ),
    "hdr": (IMAGE, content(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 30000 +X 30000\n"), "002.png"),
    "pam": (IMAGE, content(b"P7\nWIDTH 30000\nHEIGHT 30000\nDEPTH 3\nMAXVAL 255\nTUPLTYPE RGB\nENDHDR\n"), "002.png"),
    "ppm": (IMAGE, content(b"P6\n30000 30000\n255\n"), "128 megapixels"),
    "endless cameras": ("transforms.json", endless, "more than 256 MB: set GTLAYOUT_MAX_FILE_MB"),
    "cameras that are a pipe": ("transforms.json", pipe, "transforms.json"),
    "endless drawings": ("annotations.json", endless, "no annotations in"),
    "drawings that are a pipe": ("annotations.json", pipe, "annotations.json"),
    "drawings in a zip": ("annotations.json", in_a_zip, "more than 256 MB: set GTLAYOUT_MAX_FILE_MB"),
    "huge drawings": ("annotations.json", sparse, "more than 256 MB: set GTLAYOUT_MAX_FILE_MB"),
    "measurements": ("measurements.json", endless, "more than 256 MB: set GTLAYOUT_MAX_FILE_MB"),
    "unit": ("scene.json", pipe, "it is a pipe"),
}
"""What → file of the scene, what is done to it, what is said of it."""


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Answer]:
    """All in one process: loading it takes longer than they do."""
    root = tmp_path_factory.mktemp("bombs")
    scenes = {}
    FORMATS["nerfstudio"](root / "good", cameras_in_general_position())
    for name, (file, spoil, _) in BOMBS.items():
        scenes[name] = root / name
        shutil.copytree(root / "good", scenes[name])
        spoil(scenes[name] / file)
    for name, write in FORMATS.items():
        scenes[name] = root / "cameras" / name
        for path in write(scenes[name], cameras_in_general_position()):
            sparse(path)
    asked = json.dumps({name: str(folder) for name, folder in scenes.items()})
    ran = subprocess.run(
        [sys.executable, "-c", CHILD, str(MEMORY_BYTES), asked],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr == ""
    return {name: Answer(*found) for name, found in json.loads(ran.stdout).items()}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused(name: str, answers: dict[str, Answer]) -> None:
    answer = answers[name]
    assert answer.status in (1, 3)
    assert BOMBS[name][2] in " ".join(answer.text.split())
    assert answer.cpu_s < CPU_S


@pytest.mark.parametrize("name", FORMATS)
def test_camera_files_of_any_size(name: str, answers: dict[str, Answer]) -> None:
    answer = answers[name]
    assert answer.status == 1
    assert "MB: set GTLAYOUT_MAX_" in " ".join(answer.text.split())
    assert answer.cpu_s < CPU_S
