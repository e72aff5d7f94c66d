"""Can the unit of a scene be the metre?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtlayout.figures import short
from gtlayout.instances import Instance, Plane
from gtlayout.quality.config import QualityConfig
from gtlayout.scene import FloatArray, Scene

OTHER_UNITS = ((600.0, "centimetres"), (10_000.0, "millimetres"))
"""Up to which depth what unit is likely: rooms are 0.6 to 6 m deep."""
MEND = 'name the unit of the cameras in scene.json ({"unit": "mm"}, cm, m, in or ft), or {"metric": false} there'


def unit_doubt(
    scene: Scene, instances: Sequence[Instance], planes: Sequence[Plane], known_m: FloatArray, config: QualityConfig
) -> str | None:
    """Why a metric scene cannot be in metres, and what to do; None when it can, or is not metric.

    ``known_m``: (N,) distances to what is drawn, where they are known.
    """
    if not scene.metric:
        return None
    middle = float(np.median(known_m)) if len(known_m) else np.nan
    if (why := depth_doubt(middle, config)) is not None:
        return f"the scene counts as metric, but what is drawn is {why}; {MEND}"
    centers = np.array([frame.camera.center_world for frame in scene.frames])
    heights = [
        float(np.median(np.abs(centers @ plane.normal + plane.d)))
        for instance, plane in zip(instances, planes, strict=True)
        if instance.label == "floor" and plane.observable
    ]
    if heights and min(heights) > config.max_camera_height_m:
        return (
            f"the scene counts as metric, but its cameras are {short(min(heights))} m above the floor (median), higher "
            f"than any room; {MEND}"
        )
    return None


def depth_doubt(median_depth: float, config: QualityConfig) -> str | None:
    """Why the median depth of a scene cannot be in metres; None when it can, or is not known."""
    most = config.max_room_depth_m
    if np.isnan(median_depth) or config.min_room_depth_m <= median_depth <= most:
        return None
    likely = next((name for limit, name in OTHER_UNITS if most < median_depth <= limit), None)
    unit = f"that looks like {likely}" if likely else "no room is that size"
    return f"{short(median_depth)} m away (median): {unit}"
