"""Which wall a door or window lies in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtlayout.instances import Instance
from gtlayout.scene import OPENINGS, SAME_BORDER_PX, Element, Label, Scene

_HOST_LABELS: dict[Label, tuple[Label, ...]] = {
    "door": ("wall", "slanted"),
    "window": ("wall", "slanted", "ceiling"),
}
_DECIMALS = 6
"""Of a pixel."""


def find_hosts(scene: Scene, instances: Sequence[Instance]) -> list[int | None]:
    """The host of each door and window: the instance that it shares most border with over all key frames; else None."""
    shared = np.zeros((len(instances), len(instances)))
    for k, key_frame in enumerate(scene.key_frames):
        here = {element: i for i, instance in enumerate(instances) for frame, element in instance.members if frame == k}
        for a, opening in here.items():
            if instances[opening].label not in OPENINGS:
                continue
            for b, host in here.items():
                if instances[host].label in _HOST_LABELS[instances[opening].label]:
                    shared[opening, host] += _shared_border_px(key_frame.elements[a], key_frame.elements[b])
    # Rounded, the first of those that share the whole border wins, whatever the last bit of its length is.
    return [int(np.argmax(row)) if row.any() else None for row in shared.round(_DECIMALS)]


def _shared_border_px(opening: Element, host: Element) -> float:
    """Length of the opening's border that runs along the host, or lies on it where the host is drawn through."""
    return float(opening.amodal.boundary.intersection(host.amodal.buffer(SAME_BORDER_PX)).length)
