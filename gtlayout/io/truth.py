"""gt_planes.json, ``"format": "gtlayout-truth/1"``: the true planes of a scene, and which element lies on which."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json
from gtlayout.io.numbers import real, reals
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
    extent_world: tuple[tuple[FloatArray, ...], ...] | None = None
    """The part of it that the key frames show, behind furniture and with doors and windows: per polygon its outer
    ring and its holes, (N, 3) each; None = not known."""


@dataclass(frozen=True)
class Truth:
    """True planes by name."""

    planes: dict[str, TruePlane]
    elements: dict[tuple[int, int], str]
    """(key frame index, element index) → name of its plane."""

    def scaled(self, factor: float) -> Truth:
        """The same in a world whose unit is smaller by ``factor``."""
        planes = {
            name: replace(
                plane,
                d=factor * plane.d,
                extent_world=None
                if plane.extent_world is None
                else tuple(tuple(factor * ring for ring in polygon) for polygon in plane.extent_world),
            )
            for name, plane in self.planes.items()
        }
        return replace(self, planes=planes)


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
        frame = scene.frame_of(k).name
        names = elements.get(frame, {})
        if not isinstance(names, dict):
            raise GtlayoutError(f"{path}: the elements of {frame} must be an object, element id: plane name")
        for e, element in enumerate(key_frame.elements):
            if element.id in names:
                name = names[element.id]
                if not isinstance(name, str) or name not in found:
                    raise GtlayoutError(f"{path}: element {element.id} of {frame} lies on the unknown plane {name!r}")
                of[k, e] = name
    return Truth(found, of)


def _plane(plane: dict[str, object]) -> TruePlane:
    if plane["normal"] is None:
        return TruePlane(np.full(3, np.nan), np.nan, False)
    normal, d = reals(plane["normal"], (3,)), real(plane["d"])
    length = float(np.linalg.norm(normal))
    if length == 0.0:
        raise ValueError(f"normal {plane['normal']} is none")
    # Files round: a normal with six digits is off unit length by enough to look like an angle of 0.07°.
    return TruePlane(normal / length, d / length, bool(plane.get("from_depth", True)), _extent(plane.get("extent")))


def _extent(polygons: Any) -> tuple[tuple[FloatArray, ...], ...] | None:
    """Rings from nested lists of numbers."""
    if polygons is None:
        return None
    rings = tuple(tuple(reals(ring, (-1, 3)) for ring in polygon) for polygon in polygons)
    if any(len(ring) < 3 for polygon in rings for ring in polygon):
        raise ValueError("a ring of its extent is no list of at least 3 points [x, y, z]")
    return rings
