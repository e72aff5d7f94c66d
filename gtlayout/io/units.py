"""``scene.json``: the unit of the camera file's lengths, which become metres here and nowhere else.

``{"unit": "mm"}`` (or cm, m, in, ft) makes a scene metric; ``{"metric": true}`` is the same as m, ``{"metric": false}``
says that the unit is not known. Depth maps are millimetres and ``gt_planes.json`` is in metres in a scene that is
metric, whatever the unit of its cameras.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json
from gtlayout.io.sources import PosedImages

SCENE_FILE = "scene.json"
METRES = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254, "ft": 0.3048}
"""In each unit that ``unit`` may be."""


@dataclass(frozen=True)
class Unit:
    """What a scene says of its unit."""

    metric: bool | None = None
    """Whether it is known; None = nothing is said."""
    metres: float = 1.0
    """In one unit of the cameras."""


def read_unit(path: Path) -> Unit:
    """Read ``scene.json``, which need not exist. Raises GtlayoutError naming it when it says nothing, or two things."""
    if not path.exists():
        return Unit()
    data = read_json(path)
    metric, unit = data.get("metric"), data.get("unit")
    known = set(data) <= {"metric", "unit"} and data and isinstance(data.get("metric", True), bool)
    if not known or ("unit" in data and not (isinstance(unit, str) and unit in METRES)):
        units = ", ".join(f'"{name}"' for name in METRES)
        raise GtlayoutError(
            f'{path} must be {{"unit": …}} with one of {units}, or {{"metric": true}} or {{"metric": false}}'
        )
    if metric is False and unit is not None:
        raise GtlayoutError(f'{path}: "metric": false says that the unit is not known, "unit": "{unit}" that it is')
    return Unit(metric, 1.0) if unit is None else Unit(True, METRES[unit])


def in_metres(cameras: PosedImages, unit: Unit) -> PosedImages:
    """The cameras with positions in metres where the unit is known, else as they are."""
    images = tuple(replace(image, t_cam_from_world=unit.metres * image.t_cam_from_world) for image in cameras.images)
    return cameras if unit.metres == 1 else replace(cameras, images=images)
