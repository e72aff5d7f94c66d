"""Writing a scene folder: any format of cameras with any of annotations. A format is one entry in a table below."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from gtlayout.io.annotations.annotation_files import NATIVE_FILE
from gtlayout.io.annotations.coco.reader import write_coco
from gtlayout.io.annotations.cvat.writer import write_cvat
from gtlayout.io.annotations.labelme import write_labelme
from gtlayout.io.annotations.native import write_annotations
from gtlayout.io.cad_estate.writer import FRAME_US, write_clip, write_masks
from gtlayout.io.cameras.colmap.reader import write_colmap
from gtlayout.io.cameras.nerfstudio import FILE_NAME as TRANSFORMS_FILE
from gtlayout.io.cameras.nerfstudio import write_transforms
from gtlayout.io.cameras.re10k import write_re10k
from gtlayout.io.cameras.scannet import write_scannet
from gtlayout.io.files import new_folder, write_json_atomic
from gtlayout.io.measurements import FILE as MEASUREMENTS_FILE
from gtlayout.io.measurements import write_measurements
from gtlayout.io.pixels.exports import the_one_size, write_depth, write_image, write_jpeg, write_truth
from gtlayout.io.units import SCENE_FILE
from gtlayout.io.video_record import origin_of, write_video_record
from gtlayout.scene import Frame, KeyFrame, Scene

CameraFormat = Literal["native", "colmap", "re10k", "scannet", "cad-estate"]
AnnotationFormat = Literal["native", "cvat", "coco", "labelme", "cad-estate"]
NO_ADDRESS = "file://"
"""RealEstate10k's first line is the address of a video on the net."""
ElementIds = dict[tuple[int, int], str]
"""(key frame, element) → its id in the file; elements that have none there are left out."""
CameraWriter = Callable[[Scene, Path], tuple[Frame, ...]]
"""Writes a scene's images and cameras to a folder; returns the frames as they are there."""
AnnotationWriter = Callable[[Scene, Path], ElementIds]
"""Writes a scene's key frames, of frames that are there already, to a folder."""


def write_scene(scene: Scene, out: Path, cameras: CameraFormat, annotations: AnnotationFormat) -> tuple[str, ...]:
    """Write ``scene`` to the folder ``out``, new or empty: all of it or nothing. Returns the frames' names there.

    Images without distortion, depth maps where the format has them, cameras, annotations if there are any, and
    ``gt_planes.json`` if the scene has one; ``scene.json`` says the unit where the format does not. JPEG images without
    distortion, and others that the format takes, are copied byte by byte.

    Raises GtlayoutError when ``out`` is not empty, the format cannot say what the scene is (several cameras, no metric
    unit), an image or a depth map cannot be read, or the disk does not take them.
    """
    with new_folder(out) as folder:
        written = replace(scene, frames=CAMERA_WRITERS[cameras](scene, folder))
        if cameras not in METRIC_FORMATS or scene.scale_sigma_share is not None:
            sigma = {} if scene.scale_sigma_share is None else {"scale_sigma": scene.scale_sigma_share}
            write_json_atomic(folder / SCENE_FILE, {"metric": scene.metric, **sigma})
        ids: ElementIds = {}
        if scene.key_frames:
            ids = ANNOTATION_WRITERS[annotations](written, folder)
            write_truth(folder, scene, written.frames, ids)
        if scene.measurements:
            write_measurements(folder / MEASUREMENTS_FILE, scene, written.frames, ids)
    return tuple(frame.name for frame in written.frames)


def _write_nerfstudio(scene: Scene, out: Path) -> tuple[Frame, ...]:
    frames = _write_images(scene, out)
    write_transforms(out / TRANSFORMS_FILE, frames)
    origins = {new.name: origin_of(frame) for frame, new in zip(scene.frames, frames, strict=True)}
    write_video_record(out, {name: origin for name, origin in origins.items() if origin is not None})
    return frames


def _write_colmap(scene: Scene, out: Path) -> tuple[Frame, ...]:
    frames = _write_images(scene, out)
    # In COLMAP's text files a name ends at the first blank.
    write_colmap(out / "sparse/0", frames, binary=any(re.search(r"\s", frame.name) for frame in frames))
    return frames


def _write_re10k(scene: Scene, out: Path) -> tuple[Frame, ...]:
    the_one_size(out, scene)
    written = []
    timestamps_us = [i * FRAME_US for i in range(len(scene.frames))]
    for frame, timestamp_us in zip(scene.frames, timestamps_us, strict=True):
        image = out / "images" / f"{timestamp_us}.jpg"
        write_jpeg(image, frame)
        written.append(Frame(image.name, image, frame.camera))
    write_re10k(out / "cameras.txt", written, timestamps_us, NO_ADDRESS)
    return tuple(written)


def _write_images(scene: Scene, out: Path) -> tuple[Frame, ...]:
    """``images/`` and ``depth/``, as ``load_scene`` looks for them."""
    written = []
    for frame in scene.frames:
        image = write_image(out / "images", frame)
        name = image.relative_to(out / "images")
        write_depth((out / "depth" / name).with_suffix(".png"), frame)
        written.append(Frame(name.as_posix(), image, frame.camera))
    return tuple(written)


def write_to(name: str, write: Callable[[Path, Sequence[Frame], Sequence[KeyFrame]], None]) -> AnnotationWriter:
    """A writer of a file called ``name``."""

    def write_file(scene: Scene, out: Path) -> ElementIds:
        write(out / name, scene.frames, scene.key_frames)
        return _own_ids(scene)

    return write_file


def _write_labelme(scene: Scene, _out: Path) -> ElementIds:
    # Beside the images, where LabelMe looks for them.
    first = scene.frames[0]
    write_labelme(first.image_path.parents[first.name.count("/")], scene.frames, scene.key_frames)
    return _own_ids(scene)


def _own_ids(scene: Scene) -> ElementIds:
    return {(k, e): element.id for k, key in enumerate(scene.key_frames) for e, element in enumerate(key.elements)}


CAMERA_WRITERS: dict[CameraFormat, CameraWriter] = {
    "native": _write_nerfstudio,
    "colmap": _write_colmap,
    "re10k": _write_re10k,
    "scannet": write_scannet,
    "cad-estate": write_clip,
}
METRIC_FORMATS: frozenset[CameraFormat] = frozenset({"scannet"})
"""Their unit is the metre; others do not say."""
ANNOTATION_WRITERS: dict[AnnotationFormat, AnnotationWriter] = {
    "native": write_to(NATIVE_FILE, write_annotations),
    "cvat": write_to("annotations.xml", write_cvat),
    "coco": write_to("coco.json", write_coco),
    "labelme": _write_labelme,
    "cad-estate": write_masks,
}
