"""From posed images, with any lens, to frames with pinhole cameras in video order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.undistort import undistortion
from gtlayout.io.cameras.upright import Turned, header_with_tag, is_of_shown, orientation_lines, upright
from gtlayout.io.image_names import FilesOnDisk
from gtlayout.io.pixels.images import decode
from gtlayout.io.pixels.registration import Pinhole, Registration
from gtlayout.io.pixels.turn import AS_STORED, Header
from gtlayout.io.sources import PosedImage
from gtlayout.scene import Camera, Frame

MIN_FRAMES = 3
"""Two views of a point cannot contradict each other, so good and bad tracks could not be distinguished."""
MAX_POSITION = 1e9
"""In any unit; beyond it, a number is damage."""


def build_frames(root: Path, images: Sequence[PosedImage]) -> tuple[tuple[Frame, ...], tuple[str, ...], list[str]]:
    """Frames in natural order of their names, the names of cameras without an image file, and warnings.

    Frames stand upright: an image with an orientation tag is turned, and its camera with it. To compare sizes, one
    image per image size is decoded; whether the others can be read shows when they are used.
    Raises GtlayoutError when names occur twice, no or hardly any image file is there, a lens cannot be undistorted,
    a camera is nowhere, or the images do not have the size that their camera says.
    """
    files = FilesOnDisk()
    ordered = sorted(_on_disk(images, files), key=lambda image: natural(image.name))
    for previous, image in pairwise(ordered):
        if previous.name == image.name:
            raise GtlayoutError(f"{root}: two cameras for one image, {image.name}")
    present = [image for image in ordered if image.is_there]
    missing = [image for image in ordered if not image.is_there]
    if not present:
        looked_for = missing[0].image_path
        raise GtlayoutError(
            f"{root}: no image file for any of {len(missing)} cameras; looked for {looked_for} and so on"
        )
    warnings = []
    if missing:
        first = missing[0].image_path
        warnings.append(f"{len(missing)} of {len(ordered)} cameras have no image file and were skipped, first {first}")
    if len(present) < MIN_FRAMES:
        raise GtlayoutError(
            f"{root}: {len(present)} frames with camera and image file, at least {MIN_FRAMES} are needed "
            f"({len(ordered)} cameras)"
        )
    headers = [header_with_tag(image) for image in present]
    _check_sizes([image for image, header in zip(present, headers, strict=True) if not is_of_shown(image, header)])
    frames = tuple(_frame(root, image, header, files) for image, header in zip(present, headers, strict=True))
    warnings += orientation_lines(present, headers)
    if (root / "depth").is_dir() and not any(frame.depth_path for frame in frames):
        warnings.append(
            f"{root / 'depth'} holds no map for any frame; looked for {_depth_path(root, present[0])} and so on"
        )
    return frames, tuple(image.name for image in missing), warnings


def _on_disk(images: Sequence[PosedImage], files: FilesOnDisk) -> list[PosedImage]:
    """The images, those whose file is spelled otherwise on disk with the path that it has."""
    paths = files.find_each([[] if image.video is not None else [image.image_path] for image in images])
    return [replace(image, image_path=path) if path else image for image, path in zip(images, paths, strict=True)]


def _frame(root: Path, image: PosedImage, header: Header | None, files: FilesOnDisk) -> Frame:
    try:
        lens = undistortion(image.camera)
    except GtlayoutError as error:
        raise GtlayoutError(f"{image.image_path}: {error}") from error
    if not np.all(np.abs(image.t_cam_from_world) <= MAX_POSITION):
        raise GtlayoutError(f"{image.image_path}: its camera's translation cannot be one: {image.t_cam_from_world}")
    pinhole = lens.target if lens else image.camera
    seen = Camera(
        K=np.array(pinhole.calibration_matrix(), dtype=np.float64),
        R_cam_from_world=image.R_cam_from_world,
        t_cam_from_world=image.t_cam_from_world,
        width=int(pinhole.width),
        height=int(pinhole.height),
    )
    depth_path = files.find(_depth_path(root, image))
    register = (
        Registration(image.depth_camera, Pinhole(seen.K, seen.width, seen.height)) if image.depth_camera else None
    )
    if header is None:
        return Frame(image.name, image.image_path, seen, lens, depth_path, register, image.video)
    turned = upright(header, lens, of_shown=is_of_shown(image, header))
    camera = seen if turned.after == AS_STORED else turned.after.camera(seen)
    register_turned = Turned(register, turned.after) if register else None
    return Frame(image.name, image.image_path, camera, turned, depth_path, register_turned)


def _depth_path(root: Path, image: PosedImage) -> Path:
    return image.depth_path or (root / "depth" / image.name).with_suffix(".png")


def _check_sizes(images: Sequence[PosedImage]) -> None:
    checked: set[tuple[int, int]] = set()
    for image in images:
        expected = (image.camera.width, image.camera.height)
        if expected in checked:
            continue
        path = image.image_path
        if image.video is not None:
            path, width, height = image.video.video.path, image.video.video.width, image.video.video.height
        else:
            try:
                height, width = decode(path, cv2.IMREAD_GRAYSCALE).shape
            except GtlayoutError:
                continue  # The tracker counts unreadable images; another one shows the size.
        if (width, height) != expected:
            raise GtlayoutError(
                f"{path} is {width}x{height} px but its camera says {expected[0]}x{expected[1]}: scale one to the other"
            )
        checked.add(expected)


def natural(name: str) -> list[str | int]:
    """Sort key in which frame 2 comes before frame 10."""
    return [int(part) if i % 2 else part for i, part in enumerate(re.split(r"(\d+)", name))]
