"""CAD-Estate: ``frames.json`` with the cameras of a RealEstate10K clip, and structure annotations as masks.

A scene folder is a clip's folder as it is in the release, ``annotations/<clip>``, with ``frames.json``,
``room_structure.npz`` and ``structure_annotations/``. Its frames, ``<video>_<timestamp>.jpg``, may be where the script
of the release puts them (``frames/<video>/`` beside ``annotations/``), or in ``<video>/`` or ``images/`` in the folder;
or the video itself lies in the folder.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.checked import NO_OCCLUSION_EDGES, Notes
from gtlayout.io.annotations.masks import decode_mask, mask_polygons, simple_rings
from gtlayout.io.archives import read_bytes
from gtlayout.io.cad_estate.room_structure import FILE_NAME as STRUCTURE_FILE
from gtlayout.io.cad_estate.room_structure import read_room_structure
from gtlayout.io.cameras.lenses import MAX_STRETCH, finite, lens
from gtlayout.io.cameras.poses import rigid
from gtlayout.io.cameras.timed_images import TimedImages, find_timed_images
from gtlayout.io.files import read_json
from gtlayout.io.sources import (
    PosedImage,
    PosedImages,
    RawAnnotations,
    RawKeyFrame,
    RawShape,
    Reader,
    json_with,
    named,
    usable,
)
from gtlayout.scene import FloatArray, ImageArray, Label

FRAMES_FILE = "frames.json"
MASKS_FOLDER = "structure_annotations"
STRUCTURE_MASK, VISIBLE_MASK = "processed_structure_", "processed_visible_"
"""The raw ones are numbered frame by frame, and nothing says which label a number has."""
CLIP_NAME = re.compile(r"([\w-]{1,100})_\d{1,20}")
"""Video and start."""
MAX_TIMESTAMP_US = 1 << 63
MAX_QUATERNION_ERROR = 1e-3


@dataclass(frozen=True)
class Clip:
    """frames.json, and its images."""

    video: str
    frames: tuple[dict[str, Any], ...]
    images: TimedImages
    scale: FloatArray
    """(2,) x and y: pixels of the images per pixel of the intrinsics."""


def read_frames(root: Path, path: Path) -> PosedImages:
    """Read ``frames.json``: world-to-camera, intrinsics in pixels of ``image_size``, or of the images if that is null.

    Images may have another size than ``image_size``: intrinsics are scaled to them. Without images, the frames of the
    one video file in ``root`` are taken that are at the same times.
    Frames of which something is missing, not finite, or not a rotation are skipped, with a warning. Raises
    GtlayoutError naming the file when it is none, or nothing is left.
    """
    clip = _clip(root, path)
    images, skipped = usable(range(len(clip.frames)), lambda i: _posed_image(clip.frames[i], i, clip, path))
    return PosedImages(tuple(images), (*clip.images.warnings, *skipped))


def read_masks(_root: Path, path: Path) -> RawAnnotations:
    """Read the processed masks: each region becomes polygons, with the label that ``room_structure.npz`` gives it.

    Ids are the masks' numbers. Masks may have another size than the images: polygons are scaled to them. Masks that are
    no 8-bit grey image, and elements that are noise or have a number without a label, are dropped with a warning.
    Raises GtlayoutError naming the first mask when none can be used.
    """
    masks = sorted(path.glob(f"{STRUCTURE_MASK}*.png"))
    if not masks:
        raise GtlayoutError(f"{path} holds no mask; looked for {STRUCTURE_MASK}<video>_<timestamp>.png")
    root = path.parent
    labels = read_room_structure(root / STRUCTURE_FILE).labels
    frames_file = root / FRAMES_FILE
    size = _clip(root, frames_file).images.size if frames_file.exists() else None
    key_frames, warnings, broken = [], [f"{path}: masks carry {NO_OCCLUSION_EDGES}"], []
    notes, without_visible = Notes(), []
    for mask in masks:
        visible = mask.with_name(VISIBLE_MASK + mask.name.removeprefix(STRUCTURE_MASK))
        if not visible.exists():
            without_visible.append(visible.name)
        try:
            key_frames.append(_key_frame(mask, visible, labels, size, notes))
        except GtlayoutError as error:
            broken.append(str(error))
    if not key_frames:
        raise GtlayoutError(broken[0])
    if broken:
        warnings.append(f"{len(broken)} of {len(masks)} masks cannot be used and were skipped, first: {broken[0]}")
    warnings += notes.lines(path.name)
    if without_visible:
        count = f"{len(without_visible)} of {len(masks)} key frames"
        warnings.append(f"{path}: {count} have no mask of visible parts, first {without_visible[0]}")
    return RawAnnotations(path, tuple(key_frames), tuple(warnings))


def image_folder(root: Path) -> Path | None:
    """The folder with a clip's images, which may lie outside ``root``; None when that is no clip with images."""
    try:
        return _clip(root, root / FRAMES_FILE).images.paths[0].parent
    except GtlayoutError:
        return None


def _clip(root: Path, path: Path) -> Clip:
    data = read_json(path)
    name, frames = data.get("clip_name"), data.get("frames")
    match = CLIP_NAME.fullmatch(name) if isinstance(name, str) else None
    if match is None:
        raise GtlayoutError(f"{path}: clip_name must be <video>_<start>, not {name!r}")
    if not isinstance(frames, list) or not frames:
        raise GtlayoutError(f"{path} has no frames")
    for i, frame in enumerate(frames):
        if not isinstance(frame, dict) or not _is_timestamp(frame.get("timestamp")):
            raise GtlayoutError(f"{path}: frame number {i} has no timestamp in whole microseconds")
    names = [f"{match[1]}_{frame['timestamp']}.jpg" for frame in frames]
    folders = (root / match[1], root / "images", root.resolve().parent.parent / "frames" / match[1])
    images = find_timed_images(root, folders, names, [frame["timestamp"] for frame in frames], path)
    scale = np.ones(2)
    if data.get("image_size") is not None:
        height, width = _numbers(data["image_size"], 2, f"{path}: image_size")
        if min(width, height) < 1:
            raise GtlayoutError(f"{path}: image_size must be [height, width] in pixels")
        scale = np.array(images.size) / (width, height)
        if abs(scale[0] / scale[1] - 1) > MAX_STRETCH:
            declared, found = f"{width:g}x{height:g}", f"{images.size[0]}x{images.size[1]}"
            raise GtlayoutError(f"{path}: image_size is {declared} (width x height) but the images are {found}")
    return Clip(match[1], tuple(frames), images, scale)


def _posed_image(frame: dict[str, Any], index: int, clip: Clip, path: Path) -> PosedImage:
    where = f"{path}: frame {frame['timestamp']}"
    pose = frame.get("extrinsics")
    if not isinstance(pose, dict):
        raise GtlayoutError(f"{where} has no extrinsics")
    fx, fy, cx, cy = _numbers(frame.get("intrinsics"), 4, f"{where}: intrinsics")
    if min(fx, fy) <= 0:
        raise GtlayoutError(f"{where}: focal lengths must be positive")
    w, x, y, z = quat_wxyz = _numbers(pose.get("rotation"), 4, f"{where}: rotation")
    length = math.hypot(*quat_wxyz)
    if abs(length - 1) > MAX_QUATERNION_ERROR:
        raise GtlayoutError(f"{where}: rotation is no unit quaternion (its length is {length:.4g})")
    turned = np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix(), dtype=np.float64)
    moved = _numbers(pose.get("translation"), 3, f"{where}: translation")
    name = f"{clip.video}_{frame['timestamp']}.jpg"
    scale_x, scale_y = clip.scale
    return PosedImage(
        name,
        clip.images.paths[index],
        lens("PINHOLE", clip.images.size, [fx * scale_x, fy * scale_y, cx * scale_x, cy * scale_y], where),
        *rigid(np.column_stack([turned, moved]), f"{where}: the pose"),
        video=clip.images.video_frames[index],
    )


def _numbers(value: Any, count: int, where: str) -> list[float]:
    numbers = [finite(item) for item in value] if isinstance(value, list) and len(value) == count else []
    found = [number for number in numbers if number is not None]
    if len(found) != count:
        raise GtlayoutError(f"{where} must be {count} finite numbers, not {value!r}")
    return found


def _is_timestamp(value: Any) -> bool:
    return type(value) is int and 0 <= value < MAX_TIMESTAMP_US


def _key_frame(
    mask: Path,
    visible: Path,
    labels: tuple[Label | None, ...],
    image_size: tuple[int, int] | None,
    notes: Notes,
) -> RawKeyFrame:
    structure = _read_mask(mask)
    numbers = [int(number) for number in np.unique(structure) if number]
    height, width = structure.shape
    seen = _visible_mask(visible, structure, notes)
    # Masks that only say that something is visible, not what, are understood, too.
    only = set(np.unique(seen)) - {0}
    seen = np.where(seen > 0, structure, 0) if only in ({1}, {255}) else seen
    scale = np.array(image_size or (width, height)) / (width, height)
    shapes = []
    for number in numbers:
        where = f"{mask.name}, element {number}"
        if number >= len(labels):
            notes.add(f"element skipped: it has no label in {STRUCTURE_FILE}, which has {len(labels)}", where)
        elif (label := labels[number]) is not None:
            own = structure == number
            try:
                regions = (simple_rings(mask_polygons(own)), simple_rings(mask_polygons(own & (seen == number))))
            except ValueError as error:
                notes.add(f"element skipped: it {error}", where)
                continue
            polygons, visible_parts = (tuple(ring * scale for ring in rings) for rings in regions)
            shapes.append(RawShape(label, polygons, visible=visible_parts, id=str(number)))
    image = mask.stem.removeprefix(STRUCTURE_MASK) + ".jpg"
    return RawKeyFrame(image, tuple(shapes), image_size or (width, height))


def _visible_mask(path: Path, structure: ImageArray, notes: Notes) -> ImageArray:
    """Nothing but zeros where it is absent or broken: then the whole elements count."""
    try:
        if path.exists() and (seen := _read_mask(path)).shape == structure.shape:
            return seen
        problem = "it has another size" if path.exists() else None
    except GtlayoutError as error:
        problem = str(error)
    if problem is not None:
        notes.add(f"mask of visible parts skipped: {problem.removeprefix(f'{path} ')}", path.name)
    return np.zeros_like(structure)


def _read_mask(path: Path) -> ImageArray:
    try:
        return decode_mask(read_bytes(path))
    except ValueError as error:
        raise GtlayoutError(f"{path} {error}") from error


def _detect_masks(place: Path) -> list[Path]:
    """In a clip's folder; or the folder of the masks itself."""
    folder = place if place.name == MASKS_FOLDER else place / MASKS_FOLDER
    return [folder] if folder.is_dir() else []


CAMERA_READER = Reader("CAD-Estate", FRAMES_FILE, named(FRAMES_FILE), read_frames, json_with("clip_name", "frames"))
ANNOTATION_READER = Reader("CAD-Estate", MASKS_FOLDER, _detect_masks, read_masks)
