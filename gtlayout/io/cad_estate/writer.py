"""Scenes and layouts in the layout of the CAD-Estate release."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.hosts import find_hosts
from gtlayout.geometry.raster import fill, rings_of
from gtlayout.instances import Instance, Mesh
from gtlayout.io.cad_estate.reader import CLIP_NAME, FRAMES_FILE, MASKS_FOLDER
from gtlayout.io.cad_estate.room_structure import (
    DOOR_FLAG,
    FILE_NAME,
    WINDOW_FLAG,
    RoomStructure,
    write_room_structure,
)
from gtlayout.io.files import write_atomic, write_json_atomic
from gtlayout.io.pixels.exports import the_one_size, write_jpeg
from gtlayout.io.pixels.images import encoded
from gtlayout.layout import Layout
from gtlayout.scene import OPENINGS, Frame, ImageArray, IntArray, Label, Scene

FRAME_US = 33_333
"""From one frame to the next: video at 30 Hz."""
MAX_NUMBERS = 256
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


def write_clip(scene: Scene, out: Path) -> tuple[Frame, ...]:
    """Write ``<video>/<video>_<timestamp>.jpg`` and ``frames.json`` to the folder ``out``; returns the frames there.

    Timestamps are those of a video at 30 Hz; the names are made of the folder's.
    Raises GtlayoutError when an image cannot be read, frames differ in size, or the disk does not take them.
    """
    width, height = the_one_size(out, scene)
    clip_name, video = _names(out)
    written, entries = [], []
    for i, frame in enumerate(scene.frames):
        image = out / video / f"{video}_{i * FRAME_US}.jpg"
        write_jpeg(image, frame)
        camera = frame.camera
        K, quat_xyzw = camera.K, Rotation.from_matrix(camera.R_cam_from_world).as_quat()
        entries.append(
            {
                "timestamp": i * FRAME_US,
                "key_frame": False,
                "intrinsics": [K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
                "extrinsics": {"translation": camera.t_cam_from_world, "rotation": quat_xyzw[[3, 0, 1, 2]]},
            }
        )
        written.append(Frame(image.name, image, camera))
    # Last, because it is what says that a clip is here.
    write_json_atomic(out / FRAMES_FILE, {"clip_name": clip_name, "image_size": [height, width], "frames": entries})
    return tuple(written)


def write_masks(scene: Scene, out: Path, layout: Layout | None = None) -> dict[tuple[int, int], str]:
    """Write ``structure_annotations/``, named after the scene's frames, and ``room_structure.npz`` to ``out``.

    Raw and processed masks of structure and visible parts. Without a layout the structure has labels only, which masks
    alone do not carry. Processed masks number elements as the layout does; without one, the n-th wall of every key
    frame has the same number, whichever it is. Doors and windows are merged into their wall.

    Returns (key frame, element) → id, without what was merged. Raises GtlayoutError when two key frames have names that
    differ in folder or ending only, there are more elements than a mask can number, or the disk does not take them.
    """
    stems = [Path(scene.frame_of(k).name).stem for k in range(len(scene.key_frames))]
    if len(set(stems)) < len(stems):
        raise GtlayoutError(f"cannot write {out}: masks are named after images, and some have one name in two folders")
    numbering = _number(scene, layout)
    if len(numbering.labels) > MAX_NUMBERS:
        raise GtlayoutError(f"cannot write {out}: masks of 8 bits cannot number {len(numbering.labels) - 1} elements")
    for k, stem in enumerate(stems):
        _write_masks(out / MASKS_FOLDER, stem, scene, k, numbering)
    annotated_us = np.array([key_frame.frame * FRAME_US for key_frame in scene.key_frames], dtype=np.int64)
    write_room_structure(out / FILE_NAME, _structure(_names(out)[0], layout, numbering, annotated_us))
    return {
        (k, e): str(number)
        for (k, e), number in numbering.of_element.items()
        if scene.key_frames[k].elements[e].label not in OPENINGS
    }


def _names(out: Path) -> tuple[str, str]:
    """What the clip and its video are called, after their folder."""
    simple = re.sub(r"[^\w-]", "_", out.name)
    clip_name = simple if CLIP_NAME.fullmatch(simple) else f"{simple}_0"
    return clip_name, clip_name.rpartition("_")[0]


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
        write_atomic(folder / f"{kind}_{stem}.png", encoded(".png", mask))


def _structure(clip_name: str, layout: Layout | None, numbering: Numbering, annotated_us: IntArray) -> RoomStructure:
    mesh = Mesh.empty() if layout is None else layout.triangles
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
