"""How well lines are drawn in this scene: drawings of one outline in several key frames, beside each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from gtlayout.instances import Extent, Instance
from gtlayout.scene import FloatArray, Scene

USUAL_SIGMA_PX = 2.5
"""σ of an edge as people draw it, in an image of 640x480: measured on drawings of clips whose planes are known."""
_USUAL_MEDIAN_PX = 1.4
"""So far, in the median, such drawings lie from the outline that all key frames agree on."""
_USUAL_DRAWINGS = 4.0
"""That lines are drawn as usual is worth so many drawings."""
_BORDER_PX = 8.0
"""An outline nearer to the border of its image than this may be cut there."""
_SPACING_SHARE = 0.005
"""Distance of samples along an outline, as a share of the room's size."""
_MIN_SAMPLES = 4


def drawn_sigma_px(
    scene: Scene, instances: Sequence[Instance], extents: Sequence[Extent], seen: Sequence[int], size: float
) -> float:
    """σ of a drawn edge across itself, in pixels of an image of 640x480.

    What all drawings have wrong alike, as the frame of a door that is drawn with it, does not show in how they differ;
    it grows along with it, as far as has been measured, and counts by the usual ratio of the two.

    Args:
        seen: The instances that have a place and an extent.
        size: The room's diameter, world unit.
    """
    off_px = np.array(
        [
            median
            for i in seen
            if len(instances[i].members) > 1
            for k, e in instances[i].members
            if np.isfinite(median := _off_outline_px(scene, extents[i], k, e, _SPACING_SHARE * size))
        ]
    )
    shown = float(np.median(off_px)) / _USUAL_MEDIAN_PX if len(off_px) else 1.0
    share = (len(off_px) * shown**2 + _USUAL_DRAWINGS) / (len(off_px) + _USUAL_DRAWINGS)
    return USUAL_SIGMA_PX * float(np.sqrt(share))


def _off_outline_px(scene: Scene, extent: Extent, key_frame: int, element: int, spacing: float) -> float:
    """Median distance from an extent's outline, inside the image, to one drawing of it; NaN where too little shows."""
    camera = scene.frame_of(key_frame).camera
    outline: FloatArray = shapely.get_coordinates(shapely.segmentize(extent.region.boundary, spacing))
    points_px, depth = camera.project(extent.frame.to_world(outline))
    inside = np.minimum(points_px, np.array([camera.width, camera.height]) - points_px).min(axis=1)
    shown = (depth > 0) & (inside > _BORDER_PX * camera.annotation_scale)
    if np.count_nonzero(shown) < _MIN_SAMPLES:
        return np.nan
    drawn = scene.key_frames[key_frame].elements[element].amodal.boundary
    return float(np.median(shapely.distance(drawn, shapely.points(points_px[shown])))) / camera.annotation_scale
