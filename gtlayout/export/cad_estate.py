"""A folder as in the CAD-Estate release: cameras, images, masks, and the layout's triangles."""

from __future__ import annotations

from pathlib import Path

from gtlayout.io.cad_estate_export import write_cad_estate
from gtlayout.io.files import new_folder
from gtlayout.layout import Layout
from gtlayout.scene import Scene


def write(path: Path, scene: Scene, layout: Layout) -> None:
    """Write the folder ``path``, new or empty; it is best called ``<video>_<start>``, see ``write_cad_estate``.

    Raises GtlayoutError when it holds something, an image cannot be read, frames differ in size, or the disk does not
    take them.
    """
    with new_folder(path) as folder:
        write_cad_estate(scene, folder, layout)
