"""RealEstate10k camera files: the cameras of one clip of a real-estate video, read and written.

The dataset gives the cameras only; its users have cut the video into images called by their timestamps, or have the
video itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.archives import read_text
from gtlayout.io.cameras.lenses import lens
from gtlayout.io.cameras.poses import rigid
from gtlayout.io.cameras.timed_images import find_timed_images
from gtlayout.io.files import write_atomic
from gtlayout.io.lens import Lens
from gtlayout.io.sources import PosedImage, PosedImages, Reader, usable
from gtlayout.scene import FloatArray, Frame

COLUMNS = 19
"""Timestamp, fx fy cx cy, two zeros, the 3x4 matrix row by row."""
ADDRESS = "://"
"""What the first line, the video's address, has in it."""
MAX_ADDRESS = 4096


@dataclass(frozen=True)
class Re10kCamera:
    """One line of the file."""

    timestamp_us: int
    """Within the video."""
    focal_shares: tuple[float, float]
    """fx and fy as shares of the image's width and height."""
    center_shares: tuple[float, float]
    """cx and cy, likewise, from the image's top-left corner."""
    R_cam_from_world: FloatArray
    """(3, 3) rotation."""
    t_cam_from_world: FloatArray
    """(3,) translation, in a unit that is the clip's own."""


def read_cameras(path: Path) -> tuple[Re10kCamera, ...]:
    """Read the file; its cameras come in order of their timestamps, and rotations are made orthonormal.

    The first line, the video's address, is not kept. Raises GtlayoutError naming the file and the line for whatever
    is missing, not a finite number, not a rotation, or out of order.
    """
    cameras: list[Re10kCamera] = []
    for where, line in _lines(path):
        cameras.append(_camera(line, where))
        if len(cameras) > 1 and cameras[-1].timestamp_us <= cameras[-2].timestamp_us:
            raise GtlayoutError(f"{where}: the timestamp is not later than the one before")
    return tuple(cameras)


def read_re10k(root: Path, path: Path) -> PosedImages:
    """Read the cameras of ``path`` and find their images in ``images/``, in ``root``, or in a folder called like the
    file; without any, their frames in the one video file in ``root``.

    An image is called as its file is, a frame of the video ``<timestamp>.jpg``. Lines that are no camera, or have the
    time of an earlier one, are skipped, with a warning. Raises GtlayoutError naming the file when no line is left, or
    nothing is there at the times of its cameras.
    """
    of_time: dict[int, Re10kCamera] = {}

    def read(line: tuple[str, str]) -> Re10kCamera:
        camera = _camera(line[1], line[0])
        if camera.timestamp_us in of_time:
            raise GtlayoutError(f"{line[0]}: an earlier line has the same timestamp")
        of_time[camera.timestamp_us] = camera
        return camera

    found_cameras, skipped = usable(_lines(path), read)
    cameras = sorted(found_cameras, key=lambda camera: camera.timestamp_us)
    timestamps_us = [camera.timestamp_us for camera in cameras]
    folders = (root / "images", root, root / path.stem)
    found = find_timed_images(root, folders, [f"{us}.jpg" for us in timestamps_us], timestamps_us, path)

    def posed(number: int) -> PosedImage:
        camera, image_path = cameras[number], found.paths[number]
        lens_of = _pinhole(camera, found.size, f"{path}: camera {camera.timestamp_us}")
        pose = (camera.R_cam_from_world, camera.t_cam_from_world)
        return PosedImage(image_path.name, image_path, lens_of, *pose, video=found.video_frames[number])

    images, no_lens = usable(range(len(cameras)), posed)
    return PosedImages(tuple(images), (*skipped, *found.warnings, *no_lens))


def write_re10k(path: Path, frames: Sequence[Frame], timestamps_us: Sequence[int], url: str) -> None:
    """Write the frames' pinhole cameras, which must come in the order of their timestamps.

    Raises GtlayoutError when they do not, ``url`` is no address, or the file cannot be written.
    """
    if ADDRESS not in url or len(url.splitlines()) != 1:
        raise GtlayoutError(f"cannot write {path}: {url!r} is no address of a video")
    if any(later <= earlier for earlier, later in pairwise(timestamps_us)):
        raise GtlayoutError(f"cannot write {path}: the timestamps do not rise")
    lines = [url]
    for frame, timestamp_us in zip(frames, timestamps_us, strict=True):
        camera, K = frame.camera, frame.camera.K
        size = np.array([camera.width, camera.height])
        cam_from_world = np.column_stack([camera.R_cam_from_world, camera.t_cam_from_world])
        shares = [*(K.diagonal()[:2] / size), *(K[:2, 2] / size)]
        numbers = [repr(float(number)) for number in (*shares, 0, 0, *cam_from_world.ravel())]
        lines.append(" ".join([str(timestamp_us), *numbers]))
    write_atomic(path, "\n".join(lines) + "\n")


def _lines(path: Path) -> list[tuple[str, str]]:
    """What to call each line that should be a camera, and the line. Raises GtlayoutError when there is none."""
    lines = read_text(path).splitlines()
    if not lines or ADDRESS not in lines[0]:
        raise GtlayoutError(f"{path}, line 1 must be the address of the video")
    found = [(f"{path}, line {number}", line) for number, line in enumerate(lines[1:], start=2) if line.strip()]
    if not found:
        raise GtlayoutError(f"{path} holds no camera")
    return found


def _camera(line: str, where: str) -> Re10kCamera:
    words = line.split()
    if len(words) != COLUMNS:
        raise GtlayoutError(f"{where} has {len(words)} columns, {COLUMNS} are expected")
    try:
        timestamp_us, values = int(words[0]), np.array([float(word) for word in words[1:]])
    except ValueError as error:
        raise GtlayoutError(f"{where}: not a number: {str(error).rpartition(': ')[2]}") from error
    if not np.all(np.isfinite(values)):
        raise GtlayoutError(f"{where}: all columns must be finite numbers")
    fx, fy, cx, cy = (float(value) for value in values[:4])
    if min(fx, fy) <= 0:
        raise GtlayoutError(f"{where}: the focal lengths (columns 2 and 3) must be positive")
    cam_from_world = values[6:].reshape(3, 4)
    rotation, translation = rigid(cam_from_world, f"{where}: the pose in columns 8 to 19")
    return Re10kCamera(timestamp_us, (fx, fy), (cx, cy), rotation, translation)


def _pinhole(camera: Re10kCamera, size: tuple[int, int], where: str) -> Lens:
    shares = (*camera.focal_shares, *camera.center_shares)
    return lens("PINHOLE", size, [share * side for share, side in zip(shares, size * 2, strict=True)], where)


def _detect(root: Path) -> list[Path]:
    return [path for path in sorted(root.glob("*.txt")) if path.is_file() and _begins_with_address(path)]


def _begins_with_address(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            line = file.readline(MAX_ADDRESS)
    except OSError:
        return False
    # Alone in its line: a README, or a comment in COLMAP's cameras.txt, may name one, too.
    return ADDRESS.encode() in line and len(line.split()) == 1


def _recognise(path: Path) -> list[Path]:
    return [path] if path.is_file() and _begins_with_address(path) else []


READER = Reader("RealEstate10k", "a .txt that begins with the address of a video", _detect, read_re10k, _recognise)
