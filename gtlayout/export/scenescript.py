"""SceneScript's commands make_wall, make_door and make_window, as text (Avetisyan et al., ECCV 2024).

Parameters are those of the authors' code and of ase_scene_language.txt in Aria Synthetic Environments: metres, z up; a
wall is an upright rectangle over the line from a to b with thickness 0; a door or window is given by its centre, width
and height, and lies in a wall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from gtlayout.errors import GtlayoutError
from gtlayout.export.upright import turned, z_up_from_world
from gtlayout.geometry.strip import flat_parts
from gtlayout.instances import Extent
from gtlayout.io.files import write_atomic
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene

MAX_TILT_DEG = 10.0
"""An instance further from upright is no wall in this language."""
_FIRST_ID = {"door": 1000, "window": 2000}
"""As in the authors' files; walls count from 0."""


@dataclass(frozen=True)
class _Wall:
    number: int
    foot: FloatArray
    """(2,) of the perpendicular from the z axis to the wall's line at half its height."""
    along: FloatArray
    """(2,) unit direction of the line; foot and direction give it its place."""

    def at(self, length: float) -> FloatArray:
        """(2,) a point of the line."""
        point: FloatArray = self.foot + length * self.along
        return point


def write(path: Path, scene: Scene, layout: Layout) -> None:
    """Write one command a line: walls, then doors, then windows.

    Left out is what the language cannot describe: floor, ceiling and slanted instances, walls more than
    ``MAX_TILT_DEG`` from upright, doors and windows that lie in none of the walls. Outlines become the rectangles about
    them.

    Raises:
        GtlayoutError: the scene is not metric, which the language cannot describe; or the disk does not take the file.
    """
    if not layout.metric:
        raise GtlayoutError(
            f"cannot write {path}: SceneScript knows metres only and the scene is not metric; import it again with "
            "--known-distance or --depth-scale"
        )
    rotation = z_up_from_world(scene, layout)
    extents = [turned(extent, rotation) for extent in layout.extents]
    walls: dict[int, list[tuple[_Wall, Extent]]] = {}
    lines: list[str] = []
    for i, instance in enumerate(layout.instances):
        if instance.label == "wall" and _is_upright(extents[i]):
            # The language has straight walls only: a curved one is its facets.
            for _, facet in flat_parts(layout.planes[i], extents[i]):
                wall = _wall(len(lines), facet)
                walls.setdefault(i, []).append((wall, facet))
                lines.append(_make_wall(wall, facet))
    for label, first in _FIRST_ID.items():
        inside = [i for i, instance in enumerate(layout.instances) if instance.label == label]
        written = [i for i in inside if layout.instances[i].host in walls and not extents[i].region.is_empty]
        lines += [
            _make_opening(label, first + number, _nearest(walls[host], extents[i]), extents[i])
            for number, i in enumerate(written)
            if (host := layout.instances[i].host) is not None
        ]
    write_atomic(path, "".join(f"{line}\n" for line in lines))


def _nearest(facets: Sequence[tuple[_Wall, Extent]], opening: Extent) -> _Wall:
    """The wall that an opening is in: of a curved one the facet nearest to its middle."""
    middle = _corners(opening).mean(axis=0)
    return min(facets, key=lambda one: float(np.linalg.norm(_corners(one[1]).mean(axis=0) - middle)))[0]


def _is_upright(extent: Extent) -> bool:
    return not extent.region.is_empty and abs(_normal(extent)[2]) <= np.sin(np.deg2rad(MAX_TILT_DEG))


def _wall(number: int, extent: Extent) -> _Wall:
    normal, (low, high) = _normal(extent), _range(_corners(extent)[:, 2])
    middle = (low + high) / 2
    length = np.linalg.norm(normal[:2])
    across = normal[:2] / length
    foot = (normal @ extent.frame.origin - normal[2] * middle) / length * across
    return _Wall(number, foot, np.array([-across[1], across[0]]))


def _make_wall(wall: _Wall, extent: Extent) -> str:
    corners = _corners(extent)
    a, b = (wall.at(length) for length in _range(corners[:, :2] @ wall.along))
    low, high = _range(corners[:, 2])
    ends = {"a_x": a[0], "a_y": a[1], "a_z": low, "b_x": b[0], "b_y": b[1], "b_z": low}
    return _command("make_wall", {"id": wall.number}, {**ends, "height": high - low, "thickness": 0.0})


def _make_opening(label: str, number: int, wall: _Wall, extent: Extent) -> str:
    corners = _corners(extent)
    (start, end), (low, high) = _range(corners[:, :2] @ wall.along), _range(corners[:, 2])
    x, y = wall.at((start + end) / 2)
    place = {"position_x": x, "position_y": y, "position_z": (low + high) / 2}
    ids = {"id": number, "wall0_id": wall.number, "wall1_id": wall.number}
    return _command(f"make_{label}", ids, {**place, "width": end - start, "height": high - low})


def _command(name: str, ids: dict[str, int], numbers: dict[str, float]) -> str:
    # Adding 0 turns -0 into 0.
    rounded = {key: round(float(value), 6) + 0.0 for key, value in numbers.items()}
    return ", ".join([name, *(f"{key}={value}" for key, value in {**ids, **rounded}.items())])


def _normal(extent: Extent) -> FloatArray:
    """(3,) unit normal of the extent's plane."""
    normal: FloatArray = np.cross(*extent.frame.axes)
    return normal


def _corners(extent: Extent) -> FloatArray:
    """(N, 3) of all its outlines."""
    return extent.frame.to_world(shapely.get_coordinates(extent.region))


def _range(values: FloatArray) -> tuple[float, float]:
    return float(values.min()), float(values.max())
