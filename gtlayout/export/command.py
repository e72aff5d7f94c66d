"""The command ``gtlayout export``. Loaded only when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gtlayout.cli import RESULTS, stdout
from gtlayout.export import EXPORTERS, Format, export_layout
from gtlayout.io import load_scene
from gtlayout.io.layout_files import read_layout
from gtlayout.io.refined_cameras import with_refined_cameras


def export(
    scene_dir: Annotated[Path, Parameter(name="DIR")],
    /,
    *,
    to: Format,
    out: Path | None = None,
    layout: Path | None = None,
) -> None:
    """Write a solved layout for another program: a viewer, CAD, a data set.

    Parameters
    ----------
    scene_dir
        The scene folder.
    to
        The format: meshes (glb with y up, ply, obj), a floor plan (svg, dxf), or a folder as in the CAD-Estate release.
    out
        The file, or new folder, to write; beside the layout when not given.
    layout
        Folder that holds layout.json; DIR/gtlayout when not given.
    """
    folder = layout or scene_dir / RESULTS
    scene = with_refined_cameras(load_scene(scene_dir), folder)
    path = out or folder / EXPORTERS[to].file_name
    export_layout(path, scene, read_layout(folder, scene), to)
    stdout().print(f"Export: {path}")
