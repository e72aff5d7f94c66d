"""nerfstudio's ``transforms.json``: camera-to-world, OpenGL axes (x right, y up, z backward).

Facts from nerfstudio's documentation (data conventions) and its reader (nerfstudio_dataparser.py). The files of
instant-ngp and Blender, with an angle of view for a focal length, are read too. ``applied_transform`` is what turned
the source's world into this one: nothing here needs the source's. The unit of depth maps is no field of the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.lenses import finite
from gtlayout.io.cameras.poses import OPENGL_FROM_OPENCV, cam_from_world_opengl
from gtlayout.io.cameras.transforms_lens import read_lens, warnings_of
from gtlayout.io.files import path_inside, read_json, write_json_atomic
from gtlayout.io.image_names import FilesOnDisk
from gtlayout.io.pixels.images import size_of_first
from gtlayout.io.sources import PosedImage, PosedImages, Reader, json_with, named, usable
from gtlayout.scene import FloatArray, Frame

FILE_NAME = "transforms.json"
EXTENSIONS = ("", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG")


def read_transforms(root: Path, path: Path) -> PosedImages:
    """Read ``transforms.json``: lenses of the file or of each frame, by any of the keys that ``transforms_lens`` knows.

    Rotations are made orthonormal; positions are divided by
    ``applied_scale``, which depth maps never went through. ``file_path`` is relative to the file and may lack its
    extension. Without ``w`` and ``h`` the images are as large as the first one.
    Frames of which something is missing, not finite, not a rotation, or leads out of the scene folder are skipped, with
    a warning. Raises GtlayoutError naming the file when it is none, or nothing is left.
    """
    data = read_json(path)
    entries = data.get("frames")
    if not isinstance(entries, list) or not entries:
        raise GtlayoutError(f"{path} has no frames")
    applied_scale = finite(data.get("applied_scale", 1))
    if applied_scale is None or applied_scale <= 0:
        raise GtlayoutError(f"{path}: applied_scale must be a positive number, not {data['applied_scale']!r}")
    wanted, bad_paths = usable(range(len(entries)), lambda i: (i, _image_path(entries[i], i, root, path)))
    on_disk = FilesOnDisk().find_each([[path.with_name(path.name + e) for e in EXTENSIONS] for _, path in wanted])
    found = [(i, there or path) for (i, path), there in zip(wanted, on_disk, strict=True)]
    stated = all({"w", "h"} <= {**data, **entries[i]}.keys() for i, _ in found)
    size = None if stated else size_of_first([image_path for _, image_path in found])
    images, bad_cameras = usable(
        found, lambda each: _posed_image(entries[each[0]], each[1], data, size, applied_scale, root, path)
    )
    doubts = warnings_of([data, *(entries[i] for i, _ in found)], str(path))
    return PosedImages(tuple(images), (*bad_paths, *bad_cameras, *doubts))


def write_transforms(path: Path, frames: Sequence[Frame]) -> None:
    """Write the frames' pinhole cameras as ``transforms.json``; image paths are written relative to its folder.

    Raises GtlayoutError when an image lies outside that folder or the file cannot be written.
    """
    for frame in frames:
        if not frame.image_path.is_relative_to(path.parent):
            raise GtlayoutError(f"cannot write {path}: image {frame.image_path} lies outside its folder")
    write_json_atomic(path, transforms(path.parent, frames))


def transforms(root: Path, frames: Sequence[Frame]) -> dict[str, Any]:
    """The frames' pinhole cameras as ``transforms.json`` holds them, with image paths as of ``file_path``."""
    intrinsics = [_intrinsics_of(frame) for frame in frames]
    shared = intrinsics[0] if all(each == intrinsics[0] for each in intrinsics) else {}
    entries = []
    for frame, own in zip(frames, intrinsics, strict=True):
        world_from_cam = np.eye(4)
        world_from_cam[:3, :3] = frame.camera.R_cam_from_world.T @ OPENGL_FROM_OPENCV
        world_from_cam[:3, 3] = frame.camera.center_world
        entry = {"file_path": file_path(root, frame), "transform_matrix": world_from_cam}
        entries.append(entry if shared else {**own, **entry})
    return {"camera_model": "PINHOLE", **shared, "frames": entries}


def file_path(root: Path, frame: Frame) -> str:
    """The frame's image relative to the folder ``root``; its name alone when it lies outside."""
    inside = frame.image_path.is_relative_to(root)
    return frame.image_path.relative_to(root).as_posix() if inside else frame.name


def _image_path(entry: Any, index: int, root: Path, path: Path) -> Path:
    """The image as ``file_path`` has it, which may lack an extension."""
    if not isinstance(entry, dict) or not isinstance(entry.get("file_path"), str) or not entry["file_path"]:
        raise GtlayoutError(f"{path}: frame number {index} has no file_path")
    return path_inside(root, entry["file_path"], f"{path}: frame {entry['file_path']}")


def _posed_image(
    entry: dict[str, Any],
    image_path: Path,
    data: dict[str, Any],
    size: tuple[int, int] | None,
    applied_scale: float,
    root: Path,
    path: Path,
) -> PosedImage:
    where = f"{path}: frame {entry['file_path']}"
    depth = entry.get("depth_file_path")
    if depth is not None and not isinstance(depth, str):
        raise GtlayoutError(f"{where}: depth_file_path must be a string")
    images = root / "images"
    R_cam_from_world, t_cam_from_world = cam_from_world_opengl(
        _matrix(entry.get("transform_matrix")), f"{where}: transform_matrix"
    )
    return PosedImage(
        name=image_path.relative_to(images if image_path.is_relative_to(images) else root).as_posix(),
        image_path=image_path,
        camera=read_lens(data, entry, size, where),
        R_cam_from_world=R_cam_from_world,
        t_cam_from_world=t_cam_from_world / applied_scale,
        depth_path=None if depth is None else path_inside(root, depth, where),
    )


def _matrix(value: Any) -> FloatArray:
    """``transform_matrix`` as an array; an empty one from what is no list of numbers."""
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)


def _intrinsics_of(frame: Frame) -> dict[str, float]:
    K, camera = frame.camera.K, frame.camera
    focal_and_center = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    return {**{key: float(value) for key, value in focal_and_center.items()}, "w": camera.width, "h": camera.height}


READER = Reader(
    "nerfstudio", FILE_NAME, named(FILE_NAME), read_transforms, json_with("frames", "transform_matrix", "file_path")
)
