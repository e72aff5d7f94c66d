"""``scene.json``: the unit of the camera file's lengths, which become metres here and nowhere else.

``{"unit": "mm"}`` (or cm, m, in, ft) makes a scene metric; ``{"metric": true}`` is the same as m, ``{"metric": false}``
says that the unit is not known. ``"scale_sigma": 0.01`` beside either of the first two says that the scale of the
cameras is only good to 1 %. Depth maps are millimetres and ``gt_planes.json`` is in metres in a scene that is metric,
whatever the unit of its cameras.
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
MAX_SCALE_SIGMA = 0.5
"""A scale that is known worse is not known."""


@dataclass(frozen=True)
class Unit:
    """What a scene says of its unit."""

    metric: bool | None = None
    """Whether it is known; None = nothing is said."""
    metres: float = 1.0
    """In one unit of the cameras."""
    scale_sigma_share: float | None = None
    """σ of that, as a share of it; None = nothing is said."""


def read_unit(path: Path) -> Unit:
    """Read ``scene.json``, which need not exist. Raises GtlayoutError naming it when it says nothing, or two things."""
    if not path.exists():
        return Unit()
    data = read_json(path)
    metric, unit, sigma = data.get("metric"), data.get("unit"), data.get("scale_sigma")
    known = set(data) <= {"metric", "unit", "scale_sigma"} and data and isinstance(data.get("metric", True), bool)
    if not known or ("unit" in data and not (isinstance(unit, str) and unit in METRES)):
        units = ", ".join(f'"{name}"' for name in METRES)
        raise GtlayoutError(
            f'{path} must be {{"unit": …}} with one of {units}, or {{"metric": true}} or {{"metric": false}}, and may '
            'have "scale_sigma"'
        )
    if metric is False and unit is not None:
        raise GtlayoutError(f'{path}: "metric": false says that the unit is not known, "unit": "{unit}" that it is')
    if "scale_sigma" in data:
        if metric is not True and unit is None:
            raise GtlayoutError(f'{path}: "scale_sigma" needs a unit, or "metric": true')
        if isinstance(sigma, bool) or not isinstance(sigma, int | float) or not 0 <= sigma <= MAX_SCALE_SIGMA:
            raise GtlayoutError(
                f'{path}: "scale_sigma" must be a share from 0 to {MAX_SCALE_SIGMA:g}, 0.01 for 1 %, not {sigma!r}'
            )
    return Unit(metric, 1.0, sigma) if unit is None else Unit(True, METRES[unit], sigma)


def in_metres(cameras: PosedImages, unit: Unit) -> PosedImages:
    """The cameras with positions in metres where the unit is known, else as they are."""
    images = tuple(replace(image, t_cam_from_world=unit.metres * image.t_cam_from_world) for image in cameras.images)
    return cameras if unit.metres == 1 else replace(cameras, images=images)
