"""What every exporter of scenes needs: images as JPEG, and the truth under other names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json, write_atomic, write_json_atomic
from gtlayout.io.images import read_rgb
from gtlayout.io.truth import FILE as TRUTH_FILE
from gtlayout.scene import Frame, Scene

JPEG_QUALITY = 95


def write_jpeg(path: Path, frame: Frame) -> None:
    """Write the frame as its pinhole camera sees it; a JPEG without distortion is copied byte by byte.

    Raises GtlayoutError when the image cannot be read or written.
    """
    if frame.video is None and frame.undistort is None and frame.image_path.suffix.lower() in (".jpg", ".jpeg"):
        try:
            write_atomic(path, frame.image_path.read_bytes())
        except OSError as error:
            raise GtlayoutError(f"cannot read image {frame.image_path}: {error.strerror or error}") from error
        return
    bgr = cv2.cvtColor(read_rgb(frame), cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    write_atomic(path, data.tobytes())


def write_truth(out: Path, scene: Scene, elements: Mapping[tuple[int, int], tuple[str, str]]) -> None:
    """Write the scene's ``gt_planes.json``, if it has one, to ``out`` with other names of images and elements.

    ``elements``: (key frame index, element index) → name of the image, id of the element; what is not in it is left
    out, and so are planes that nothing lies on then. Raises GtlayoutError when the file is damaged or the disk full.
    """
    if not (scene.root / TRUTH_FILE).exists():
        return
    data: dict[str, Any] = read_json(scene.root / TRUTH_FILE)
    if not isinstance(data.get("planes"), dict) or not isinstance(data.get("elements"), dict):
        raise GtlayoutError(f'{scene.root / TRUTH_FILE} must hold "planes" and "elements"')
    renamed: dict[str, dict[str, str]] = {}
    for (k, e), (image, new_id) in elements.items():
        plane = data["elements"].get(scene.frame_of(k).name, {}).get(scene.key_frames[k].elements[e].id)
        if plane is not None:
            renamed.setdefault(image, {})[new_id] = plane
    used = {plane for of in renamed.values() for plane in of.values()}
    planes = {name: plane for name, plane in data["planes"].items() if name in used}
    write_json_atomic(out / TRUTH_FILE, {**data, "planes": planes, "elements": renamed})
