"""The command ``gtlayout export``. Loaded only when it is called."""

from __future__ import annotations

from gtlayout.api import load_solved
from gtlayout.cli.console import FROM_THE_FOLDER, Folder, NewFile, SceneDir, Sources, stdout
from gtlayout.export import EXPORTERS, Format, export_layout
from gtlayout.io.files import check_stays
from gtlayout.results.names import FOLDER


def export(
    scene_dir: SceneDir,
    /,
    *,
    to: Format,
    out: NewFile | None = None,
    layout: Folder | None = None,
    sources: Sources = FROM_THE_FOLDER,
) -> None:
    """Write a solved layout for another program: a viewer, CAD, a data set.

    Parameters
    ----------
    scene_dir
        The scene folder.
    to
        The format: meshes (glb with y up, ply, obj), a floor plan (svg, pdf for A4, dxf), a building model with z up
        (ifc, usd, scenescript), a table of all dimensions (csv), or a folder as in the CAD-Estate release.
    out
        The file, or new folder, to write; beside the layout when not given.
    layout
        Folder that holds layout.json; DIR/gtlayout when not given.
    """
    scene, solved = load_solved(scene_dir, layout, **vars(sources))
    folder = layout or scene_dir / FOLDER
    path = out or folder / EXPORTERS[to].file_name
    if out is None:
        check_stays(folder, [path.name])
    export_layout(path, scene, solved, to)
    stdout().print(f"Export: {path}")
