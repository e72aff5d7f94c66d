"""Scenes and layouts in the layout of the CAD-Estate release."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from gtlayout.errors import GtlayoutError
from gtlayout.hosts import find_hosts
from gtlayout.io.cad_estate import CLIP_NAME, FRAMES_FILE, MASKS_FOLDER
from gtlayout.io.exports import write_jpeg, write_truth
from gtlayout.io.files import write_atomic, write_json_atomic
from gtlayout.io.room_structure import DOOR_FLAG, FILE_NAME, WINDOW_FLAG, RoomStructure, write_room_structure
from gtlayout.layout import Instance, Layout, Mesh
from gtlayout.raster import fill, rings_of
from gtlayout.scene import OPENINGS, ImageArray, IntArray, Label, Scene

FRAME_US = 33_333
"""From one frame to the next: video at 30 Hz."""
FLAGS: dict[Label, int] = {"window": WINDOW_FLAG, "door": DOOR_FLAG}


@dataclass(frozen=True)
class Numbering:
    """The elements of a clip as the release numbers them, from 1 on; doors and windows have none of their own."""

    labels: tuple[Label | None, ...]
    """Of each number; None for 0, the background."""
    of_element: dict[tuple[int, int], int]
    """(key frame, element) → its number or, for a door or window, its wall's."""
    of_instance: tuple[int, ...]
    """Number of each instance of a layout, likewise; 0 for an opening without a wall."""


def write_cad_estate(scene: Scene, out: Path, layout: Layout | None = None) -> None:
    """Write ``scene`` to the folder ``out``, which is best called ``<video>_<start>`` as in the release.

    ``frames.json``, ``<video>/<video>_<timestamp>.jpg``, ``structure_annotations/`` with raw and processed masks of
    structure and visible parts, and ``room_structure.npz``: with the layout's triangles, or, without one, with labels
    only, since masks alone do not carry any. Processed masks number elements as the layout does; without a layout, the
    n-th wall of every key frame has the same number, whichever it is. Doors and windows are merged into their wall.

    Two files of our own go along: ``gt_planes.json``, if the scene has one, and ``scene.json``, if it is metric.
    Raises GtlayoutError when an image cannot be read, frames differ in size, or the disk does not take them.
    """
    cameras = [frame.camera for frame in scene.frames]
    sizes = sorted({(camera.width, camera.height) for camera in cameras})
    if len(sizes) > 1:
        raise GtlayoutError(f"cannot write {out}: the format knows one image size, the scene has {sizes}")
    clip_name = out.name if CLIP_NAME.fullmatch(out.name) else f"{out.name}_0"
    match = CLIP_NAME.fullmatch(clip_name)
    if match is None:
        raise GtlayoutError(f"cannot write {out}: a clip's name is made of letters, digits, _ and -")
    video = match[1]
    timestamps = [i * FRAME_US for i in range(len(scene.frames))]
    stems = [f"{video}_{timestamp}" for timestamp in timestamps]
    for frame, stem in zip(scene.frames, stems, strict=True):
        write_jpeg(out / video / f"{stem}.jpg", frame)

    numbering = _number(scene, layout)
    for k, key_frame in enumerate(scene.key_frames):
        _write_masks(out / MASKS_FOLDER, stems[key_frame.frame], scene, k, numbering)
    annotated = np.array([timestamps[key_frame.frame] for key_frame in scene.key_frames], dtype=np.int64)
    write_room_structure(out / FILE_NAME, _structure(clip_name, layout, numbering, annotated))
    names = {
        (k, e): (f"{stems[scene.key_frames[k].frame]}.jpg", str(number))
        for (k, e), number in numbering.of_element.items()
        if scene.key_frames[k].elements[e].label not in OPENINGS
    }
    write_truth(out, scene, names)
    if scene.metric:
        write_json_atomic(out / "scene.json", {"metric": True})
    frames = []
    for timestamp, camera in zip(timestamps, cameras, strict=True):
        K, quat_xyzw = camera.K, Rotation.from_matrix(camera.R_cam_from_world).as_quat()
        frames.append(
            {
                "timestamp": timestamp,
                "key_frame": False,
                "intrinsics": [K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
                "extrinsics": {"translation": camera.t_cam_from_world, "rotation": quat_xyzw[[3, 0, 1, 2]]},
            }
        )
    # Last, because it is what says that a scene is here.
    size = {"image_size": [sizes[0][1], sizes[0][0]]}
    write_json_atomic(out / FRAMES_FILE, {"clip_name": clip_name, **size, "frames": frames})


def _number(scene: Scene, layout: Layout | None) -> Numbering:
    """Openings without a wall have the number 0."""
    if layout is not None:
        instances = layout.instances
        hosts = [instance.host for instance in instances]
        keys = [(instance.label, i) for i, instance in enumerate(instances)]
    else:
        drawn = [
            (k, e, element.label)
            for k, key_frame in enumerate(scene.key_frames)
            for e, element in enumerate(key_frame.elements)
        ]
        instances = tuple(Instance(f"{k}/{e}", label, ((k, e),)) for k, e, label in drawn)
        hosts = find_hosts(scene, instances)
        ranks: Counter[tuple[int, Label]] = Counter()
        keys = []
        for k, _, label in drawn:
            keys.append((label, ranks[k, label]))
            ranks[k, label] += 1
    own = dict.fromkeys(key for key in keys if key[0] not in OPENINGS)
    numbers = {key: number for number, key in enumerate(own, start=1)}
    of_instance = tuple(numbers.get(keys[i] if host is None else keys[host], 0) for i, host in enumerate(hosts))
    of_element = {
        member: number
        for instance, number in zip(instances, of_instance, strict=True)
        for member in instance.members
        if number
    }
    return Numbering((None, *(label for label, _ in own)), of_element, of_instance)


def _write_masks(folder: Path, stem: str, scene: Scene, k: int, numbering: Numbering) -> None:
    camera = scene.frame_of(k).camera
    structure: ImageArray = np.zeros((camera.height, camera.width), dtype=np.uint8)
    visible = np.zeros_like(structure)
    elements = scene.key_frames[k].elements
    # Doors and windows come last: they take their place in a wall, whether or not it is drawn through them.
    for e in sorted(range(len(elements)), key=lambda e: elements[e].label in OPENINGS):
        if number := numbering.of_element.get((k, e)):
            structure[fill(rings_of(elements[e].amodal), *structure.shape)] = number
            visible[fill(rings_of(elements[e].visible), *structure.shape)] = number
    visible[visible != structure] = 0
    # As drawn: numbers that mean nothing beyond the frame.
    numbers = list(dict.fromkeys(n for e in range(len(elements)) if (n := numbering.of_element.get((k, e)))))
    as_drawn = np.zeros(256, dtype=np.uint8)
    as_drawn[numbers] = np.arange(1, len(numbers) + 1)
    masks = {
        "raw_structure": as_drawn[structure],
        "raw_visible": as_drawn[visible],
        "processed_structure": structure,
        "processed_visible": visible,
    }
    for kind, mask in masks.items():
        _, data = cv2.imencode(".png", mask)
        write_atomic(folder / f"{kind}_{stem}.png", data.tobytes())


def _structure(clip_name: str, layout: Layout | None, numbering: Numbering, annotated_us: IntArray) -> RoomStructure:
    mesh = Mesh.empty() if layout is None else layout.mesh
    instances = () if layout is None else layout.instances
    number = np.array([0, *numbering.of_instance])[mesh.face_instance + 1]
    flag = np.array([0, *(FLAGS.get(instance.label, 0) for instance in instances)])[mesh.face_instance + 1]
    order = np.argsort(number, kind="stable")
    order = order[number[order] > 0]
    return RoomStructure(
        clip_name=clip_name,
        triangles=mesh.vertices[mesh.faces[order]],
        triangle_element=number[order],
        triangle_flags=flag[order],
        labels=numbering.labels,
        annotated_timestamps=annotated_us,
    )
