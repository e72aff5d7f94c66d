"""gt_planes.json, ``"format": "gtlayout-truth/1"``: the true planes of a scene, and which element lies on which."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json
from gtlayout.scene import FloatArray, Scene

FILE = "gt_planes.json"


@dataclass(frozen=True)
class TruePlane:
    """``normal · X + d = 0``, normal towards the cameras."""

    normal: FloatArray
    """(3,); NaN when there is no trustworthy truth."""
    d: float
    scored: bool
    """Whether the plane was measured, and so may be compared with."""


@dataclass(frozen=True)
class Truth:
    """True planes by name."""

    planes: dict[str, TruePlane]
    elements: dict[tuple[int, int], str]
    """(key frame index, element index) → name of its plane."""


def read_truth(scene: Scene) -> Truth | None:
    """The scene's truth; None when it has none. Raises GtlayoutError when the file is not what it should be."""
    path = scene.root / FILE
    if not path.exists():
        return None
    data = read_json(path)
    planes, elements = data.get("planes"), data.get("elements")
    if not isinstance(planes, dict) or not isinstance(elements, dict):
        raise GtlayoutError(f'{path} must hold "planes" and "elements"')
    try:
        found = {name: _plane(plane) for name, plane in planes.items()}
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise GtlayoutError(f"{path}: a plane is damaged: {error}") from error
    of = {}
    for k, key_frame in enumerate(scene.key_frames):
        names = elements.get(scene.frame_of(k).name, {})
        for e, element in enumerate(key_frame.elements):
            if element.id in names:
                if names[element.id] not in found:
                    raise GtlayoutError(f"{path}: element {element.id} lies on the unknown plane {names[element.id]!r}")
                of[k, e] = names[element.id]
    return Truth(found, of)


def _plane(plane: dict[str, object]) -> TruePlane:
    if plane["normal"] is None:
        return TruePlane(np.full(3, np.nan), np.nan, False)
    normal = np.asarray(plane["normal"], dtype=np.float64).reshape(3)
    return TruePlane(normal, float(plane["d"]), bool(plane.get("from_depth", True)))  # type: ignore[arg-type]
