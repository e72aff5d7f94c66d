"""What every writer of scenes needs: images, depth maps, and the truth under other names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.archives import read_bytes
from gtlayout.io.files import path_inside, read_json, write_atomic, write_json_atomic
from gtlayout.io.pixels.images import MM_PER_UNIT, SATURATED, encoded, read_bgr, read_depth
from gtlayout.io.pixels.registration import DepthMap
from gtlayout.io.truth import FILE as TRUTH_FILE
from gtlayout.scene import Frame, Scene

JPEG_QUALITY = 95
JPEG_SUFFIXES = (".jpg", ".jpeg")
STARTS = {**dict.fromkeys(JPEG_SUFFIXES, b"\xff\xd8"), ".png": b"\x89PNG"}
"""How such files begin."""


def write_image(folder: Path, frame: Frame) -> Path:
    """Write the frame as its pinhole camera sees it, a JPEG or video as JPEG, others as PNG; returns where it lies.

    That is its name in ``folder``, with an ending added where the name has none of the format. JPEG and PNG files
    without distortion are copied byte by byte. Raises GtlayoutError when the image cannot be read or written.
    """
    path = path_inside(folder, frame.name, f"cannot write frame {frame.name}")
    if frame.video is not None or frame.image_path.suffix.lower() in JPEG_SUFFIXES:
        path = path if path.suffix.lower() in JPEG_SUFFIXES else path.with_name(f"{path.name}.jpg")
        write_jpeg(path, frame)
        return path
    path = path if path.suffix.lower() == ".png" else path.with_name(f"{path.name}.png")
    if is_copied(frame):
        _copy(frame.image_path, path)
    else:
        write_atomic(path, _encoded(frame, ".png", []))
    return path


def write_jpeg(path: Path, frame: Frame) -> None:
    """Write the frame as its pinhole camera sees it; a JPEG file without distortion is copied byte by byte.

    Raises GtlayoutError when the image cannot be read or written.
    """
    if is_copied(frame) and frame.image_path.suffix.lower() in JPEG_SUFFIXES:
        _copy(frame.image_path, path)
    else:
        write_atomic(path, _encoded(frame, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]))


def write_depth(path: Path, frame: Frame) -> None:
    """Write the frame's depth map as its pinhole camera sees it, uint16 thousandths of the unit; nothing without one.

    A map that is like that is copied byte by byte. Raises GtlayoutError when it cannot be read or written.
    """
    if frame.depth_path is None:
        return
    if frame.undistort is None and frame.register_depth is None and frame.depth_path.suffix.lower() == ".png":
        _copy(frame.depth_path, path)
    else:
        write_atomic(path, encoded(".png", depth_mm(frame)))


def the_one_size(out: Path, scene: Scene) -> tuple[int, int]:
    """(width, height) px of all frames. Raises GtlayoutError when they differ, for formats that know one only."""
    sizes = sorted({(frame.camera.width, frame.camera.height) for frame in scene.frames})
    if len(sizes) > 1:
        raise GtlayoutError(f"cannot write {out}: the format knows one image size, the scene has {sizes}")
    return sizes[0]


def depth_mm(frame: Frame) -> DepthMap:
    """(H, W) thousandths of the unit, 0 = none. Raises GtlayoutError when there is no map, or it cannot be read."""
    return np.nan_to_num(np.rint(read_depth(frame) * MM_PER_UNIT)).clip(0, SATURATED - 1).astype(np.uint16)


def write_truth(out: Path, scene: Scene, written: Sequence[Frame], element_ids: Mapping[tuple[int, int], str]) -> None:
    """Write the scene's ``gt_planes.json``, if it has one, to ``out`` with other names of frames and elements.

    ``written``: the scene's frames under their new names. ``element_ids``: (key frame, element) → new id; elements
    without are left out, and so are planes that nothing lies on then.
    Raises GtlayoutError when the file is damaged or cannot be written.
    """
    if not (scene.root / TRUTH_FILE).exists():
        return
    data: dict[str, Any] = read_json(scene.root / TRUTH_FILE)
    if not isinstance(data.get("planes"), dict) or not isinstance(data.get("elements"), dict):
        raise GtlayoutError(f'{scene.root / TRUTH_FILE} must hold "planes" and "elements"')
    renamed: dict[str, dict[str, str]] = {}
    for (k, e), new_id in element_ids.items():
        plane = data["elements"].get(scene.frame_of(k).name, {}).get(scene.key_frames[k].elements[e].id)
        if plane is not None:
            renamed.setdefault(written[scene.key_frames[k].frame].name, {})[new_id] = plane
    used = {plane for of in renamed.values() for plane in of.values()}
    planes = {name: plane for name, plane in data["planes"].items() if name in used}
    write_json_atomic(out / TRUTH_FILE, {**data, "planes": planes, "elements": renamed})


def is_copied(frame: Frame) -> bool:
    """Whether ``write_image`` copies the file as it is: one that is what its ending says, upright without distortion.

    Phones' HEIC and the net's WebP are often called JPEG. Of a file that is not there nothing can be said.
    """
    start = STARTS.get(frame.image_path.suffix.lower())
    if frame.video is not None or frame.undistort is not None or start is None:
        return False
    try:
        with frame.image_path.open("rb") as file:
            return file.read(len(start)) == start
    except OSError:
        return False


def _copy(source: Path, path: Path) -> None:
    write_atomic(path, read_bytes(source))


def _encoded(frame: Frame, suffix: str, parameters: list[int]) -> bytes:
    return encoded(suffix, read_bgr(frame), parameters)
