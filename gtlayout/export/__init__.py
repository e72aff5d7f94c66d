"""A solved layout for other programs. A format is one file in this package and one entry in the table below."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Literal

from gtlayout.extras import MissingExtraError
from gtlayout.layout import Layout
from gtlayout.scene import Scene

Format = Literal["glb", "ply", "obj", "cad-estate", "svg", "pdf", "dxf", "ifc", "usd", "scenescript", "csv"]
Writer = Callable[[Path, Scene, Layout], None]
"""Writes a layout, and the parts of its scene that the format holds, to a file or a new folder: all of it or nothing.

Raises GtlayoutError when the format cannot describe the layout, or it cannot be written.
"""


@dataclass(frozen=True)
class Exporter:
    """A format that layouts are exported to."""

    file_name: str
    """Name of the file or folder when no other is given."""
    module: str
    """The module with the format's ``write``; imported only when it is needed."""
    needs: str | None = None
    """The optional extra of gtlayout that the module needs."""

    @property
    def suffix(self) -> str:
        """Ending of the file name; empty for a folder."""
        return Path(self.file_name).suffix

    def load(self) -> Writer:
        """The function that writes the format. Raises MissingExtraError when what it needs is not installed."""
        try:
            writer: Writer = import_module(self.module).write
        except ModuleNotFoundError as error:
            if self.needs is None:
                raise
            raise MissingExtraError(f"{error.name} is not installed: pip install 'gtlayout[{self.needs}]'") from error
        return writer


EXPORTERS: dict[Format, Exporter] = {
    "glb": Exporter("layout.glb", "gtlayout.export.glb"),
    "ply": Exporter("layout.ply", "gtlayout.export.ply"),
    "obj": Exporter("layout.obj", "gtlayout.export.obj"),
    "cad-estate": Exporter("cad_estate", "gtlayout.export.cad_estate"),
    "svg": Exporter("floor_plan.svg", "gtlayout.export.svg"),
    "pdf": Exporter("floor_plan.pdf", "gtlayout.export.pdf"),
    "dxf": Exporter("floor_plan.dxf", "gtlayout.export.dxf", needs="dxf"),
    "ifc": Exporter("layout.ifc", "gtlayout.export.ifc", needs="ifc"),
    "usd": Exporter("layout.usda", "gtlayout.export.usd", needs="usd"),
    "scenescript": Exporter("scene_language.txt", "gtlayout.export.scenescript"),
    "csv": Exporter("dimensions.csv", "gtlayout.export.table"),
}


def export_layout(path: Path, scene: Scene, layout: Layout, to: Format) -> None:
    """Write ``layout`` to ``path`` in one of the formats; ``scene`` is the one it was solved from.

    Raises GtlayoutError when the format cannot describe the layout, needs a package that is not installed, or the file
    cannot be written. What was at ``path`` is then unchanged.
    """
    EXPORTERS[to].load()(path, scene, layout)


def unit(metric: bool) -> str:
    """The unit of lengths, as it is written in all files."""
    return "m" if metric else "scene unit (not metric)"
