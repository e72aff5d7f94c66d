"""From posed images, with any lens, to frames with pinhole cameras in video order."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.extras import MissingExtraError
from gtlayout.io.cameras.lenses import doubt, scaled
from gtlayout.io.cameras.positions import coarse_positions, without_far
from gtlayout.io.cameras.undistort import undistortion
from gtlayout.io.cameras.upright import Turned, header_with_tag, is_of_shown, orientation_lines, size_seen, upright
from gtlayout.io.image_names import FilesOnDisk
from gtlayout.io.pixels.images import decode
from gtlayout.io.pixels.registration import Pinhole, Registration
from gtlayout.io.pixels.turn import AS_STORED, Header
from gtlayout.io.sources import PosedImage, on_disk, usable
from gtlayout.limits import FRAMES
from gtlayout.scene import Camera, Frame

MIN_FRAMES = 3
"""Two views of a point cannot contradict each other, so good and bad tracks could not be distinguished."""
MAX_POSITION = 1e9
"""In any unit; beyond it, a number is damage."""


def build_frames(root: Path, images: Sequence[PosedImage]) -> tuple[tuple[Frame, ...], tuple[str, ...], list[str]]:
    """Frames in natural order of their names, the names of cameras without an image file, and warnings.

    Cameras for images of another size and the same shape are scaled. Images of which two different cameras are given,
    whose lens cannot be undistorted, whose camera is nowhere or for images of another shape are left out. Frames stand
    upright: an image with an orientation tag is turned, and its camera with it. To compare sizes, up to three images
    per image size are decoded; whether the others can be read shows when they are used.
    Raises GtlayoutError when no or hardly any image is left.
    """
    FRAMES.check(len(images), str(root))
    files = FilesOnDisk()
    kept, warnings = _without_doubles(sorted(images, key=lambda image: natural(image.name)), root)
    kept, elsewhere = without_far(kept, MAX_POSITION)
    warnings += elsewhere
    ordered = on_disk(kept, files)
    present = [image for image in ordered if image.is_there]
    missing = [image for image in ordered if not image.is_there]
    if ordered and not present:
        looked_for = missing[0].image_path
        raise GtlayoutError(
            f"{root}: no image file for any of {len(missing)} cameras; looked for {looked_for} and so on"
        )
    if missing:
        first = missing[0].image_path
        warnings.append(f"{len(missing)} of {len(ordered)} cameras have no image file and were skipped, first {first}")
    headers = {image.name: header_with_tag(image) for image in present}
    sizes = _sizes([image for image in present if headers[image.name] is None])
    fitted, other_shape = usable(present, lambda image: _fitted(image, headers[image.name], sizes))
    frames, no_frame = usable(fitted, lambda image: _frame(root, image, headers[image.name], files))
    warnings += [*_scaled(present, fitted), *other_shape, *no_frame, *_doubts(fitted)]
    warnings += orientation_lines(fitted, [headers[image.name] for image in fitted])
    if len(frames) < MIN_FRAMES:
        why = f"; {warnings[0]}" if warnings else ""
        raise GtlayoutError(
            f"{root}: {len(frames)} frames with camera and image file, at least {MIN_FRAMES} are needed "
            f"({len(images)} cameras{why})"
        )
    warnings += coarse_positions([frame.camera for frame in frames])
    if (root / "depth").is_dir() and not any(frame.depth_path for frame in frames):
        warnings.append(
            f"{root / 'depth'} holds no map for any frame; looked for {_depth_path(root, present[0])} and so on"
        )
    return tuple(frames), tuple(image.name for image in missing), warnings


def _without_doubles(ordered: Sequence[PosedImage], root: Path) -> tuple[list[PosedImage], list[str]]:
    """Images of which only one camera is given, or the same again, and a warning for each other."""
    kept, warnings = [], []
    for name, group in groupby(ordered, key=lambda image: image.name):
        first, *others = group
        if all(_same(first, other) for other in others):
            kept.append(first)
            if others:
                warnings.append(f"{root}: {name} has {len(others) + 1} cameras, all the same: one was kept")
        else:
            warnings.append(f"{root}: {len(others) + 1} cameras that differ for one image, {name}: it was left out")
    return kept, warnings


def _same(one: PosedImage, other: PosedImage) -> bool:
    return (
        one.image_path == other.image_path
        and one.camera == other.camera
        and np.allclose(one.R_cam_from_world, other.R_cam_from_world, atol=1e-9)
        and np.allclose(one.t_cam_from_world, other.t_cam_from_world, rtol=1e-9)
    )


def _frame(root: Path, image: PosedImage, header: Header | None, files: FilesOnDisk) -> Frame:
    try:
        lens = undistortion(image.camera)
    except MissingExtraError:
        raise
    except GtlayoutError as error:
        raise GtlayoutError(f"{image.image_path}: {error}") from error
    if not np.all(np.abs(image.t_cam_from_world) <= MAX_POSITION):
        raise GtlayoutError(
            f"{image.image_path}: its camera's translation cannot be one: {image.t_cam_from_world}, more than "
            f"{MAX_POSITION:g} from the origin"
        )
    pinhole = lens.target if lens else image.camera
    seen = Camera(
        K=pinhole.K,
        R_cam_from_world=image.R_cam_from_world,
        t_cam_from_world=image.t_cam_from_world,
        width=pinhole.width,
        height=pinhole.height,
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


def _sizes(images: Sequence[PosedImage]) -> dict[tuple[int, int], tuple[int, int]]:
    """For each size that cameras say the one that their images have: that of most of the first, middle and last."""
    groups: dict[tuple[int, int], list[PosedImage]] = defaultdict(list)
    for image in images:
        groups[image.camera.width, image.camera.height].append(image)
    found = {}
    for stated, group in groups.items():
        samples = {0: group[0], len(group) // 2: group[len(group) // 2], len(group) - 1: group[-1]}.values()
        # Where none of these can be read, the tracker counts unreadable images.
        sizes = Counter(size for image in samples if (size := _size(image)) is not None)
        found[stated] = stated if stated in sizes or not sizes else sizes.most_common(1)[0][0]
    return found


def _size(image: PosedImage) -> tuple[int, int] | None:
    """(width, height) px of the image file or video; None when it cannot be read."""
    if image.video is not None:
        return image.video.video.width, image.video.video.height
    try:
        height, width = decode(image.image_path, cv2.IMREAD_GRAYSCALE).shape
    except GtlayoutError:
        return None
    return width, height


def _fitted(image: PosedImage, header: Header | None, sizes: Mapping[tuple[int, int], tuple[int, int]]) -> PosedImage:
    """The image with its camera for the size that images have, with a tag as shown or as stored, whichever it is of.

    Raises GtlayoutError when these have another shape.
    """
    stated = (image.camera.width, image.camera.height)
    size = sizes[stated] if header is None else size_seen(image, header)
    if size == stated:
        return image
    path = image.video.video.path if image.video else image.image_path
    return replace(image, camera=scaled(image.camera, size, f"{path}: its camera"))


def _scaled(before: Sequence[PosedImage], after: Sequence[PosedImage]) -> list[str]:
    """A warning about cameras that were scaled, for each size that they were for."""
    stated = {image.name: (image.camera.width, image.camera.height) for image in before}
    changes: dict[tuple[int, ...], list[PosedImage]] = defaultdict(list)
    for image in after:
        size = (image.camera.width, image.camera.height)
        if size != stated[image.name]:
            changes[*stated[image.name], *size].append(image)
    return [
        f"{len(group)} of {len(before)} cameras are for images of {w0}x{h0} px, but the images are {w1}x{h1}: their "
        f"intrinsics were scaled, first that of {group[0].image_path}"
        for (w0, h0, w1, h1), group in changes.items()
    ]


def _doubts(images: Sequence[PosedImage]) -> list[str]:
    """A warning when intrinsics may not be those of their images."""
    doubted = [(image, why) for image in images if (why := doubt(image.camera)) is not None]
    if not doubted:
        return []
    image, why = doubted[0]
    return [
        f"{len(doubted)} of {len(images)} cameras may not be those of their images, first {image.image_path}: {why}"
    ]


def natural(name: str) -> list[str | int]:
    """Sort key in which frame 2 comes before frame 10."""
    return [int(part) if i % 2 else part for i, part in enumerate(re.split(r"(\d+)", name))]
