"""A folder as in the CAD-Estate release: cameras, images, masks, and the layout's triangles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gtlayout.io.cad_estate.writer import write_clip, write_masks
from gtlayout.io.files import new_folder, write_json_atomic
from gtlayout.io.pixels.exports import write_truth
from gtlayout.io.units import SCENE_FILE
from gtlayout.layout import Layout
from gtlayout.scene import Scene


def write(path: Path, scene: Scene, layout: Layout) -> None:
    """Write the folder ``path``, new or empty; it is best called ``<video>_<start>``, see ``write_cad_estate``.

    Raises GtlayoutError when it holds something, an image cannot be read, frames differ in size, or the disk does not
    take them.
    """
    with new_folder(path) as folder:
        write_cad_estate(scene, folder, layout)


def write_cad_estate(scene: Scene, out: Path, layout: Layout) -> None:
    """Write ``scene`` and its layout to the folder ``out``, which is best called ``<video>_<start>`` as in the release.

    ``frames.json``, images, masks, and ``room_structure.npz`` with the layout's triangles, see ``write_clip`` and
    ``write_masks``. Two files of our own go along: ``gt_planes.json``, if the scene has one, and ``scene.json``.
    Raises GtlayoutError when an image cannot be read, frames differ in size, or the disk does not take them.
    """
    written = replace(scene, frames=write_clip(scene, out))
    write_truth(out, scene, written.frames, write_masks(written, out, layout))
    write_json_atomic(out / SCENE_FILE, {"metric": scene.metric})
