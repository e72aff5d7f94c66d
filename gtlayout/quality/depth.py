"""Distance and σ of depth of everything that is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gtlayout.geometry.depth import sigma_depth
from gtlayout.geometry.raster import annotated_labels
from gtlayout.geometry.strip import StripFrame, sigma_depth_on
from gtlayout.instances import Instance, Plane
from gtlayout.scene import FloatArray, IntArray, Scene

_STEP_PX = 4
"""Grid on which σ of depth is sampled: planes have no detail."""


@dataclass(frozen=True)
class DrawnPixels:
    """The pixels of all key frames on which an element is drawn, on a grid."""

    instance: IntArray
    """(N,) the instance on top."""
    distance: FloatArray
    """(N,) from the camera to its plane, world unit; NaN where the plane is not seen."""
    sigma_share: FloatArray
    """(N,) σ of depth as a share of it, at most 1; 1 also where a plane is unobservable or not seen."""


def drawn_pixels(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    strips: Mapping[int, StripFrame] | None = None,
) -> DrawnPixels:
    """Distance and σ of depth of everything that is drawn in all key frames; curved walls are on their ``strips``."""
    on = strips or {}
    owners, distances, shares = [np.empty(0, dtype=np.int64)], [np.empty(0)], [np.empty(0)]
    for k in range(len(scene.key_frames)):
        camera = scene.frame_of(k).camera
        labels = annotated_labels(scene, instances, k)[::_STEP_PX, ::_STEP_PX]
        for i in np.unique(labels[labels >= 0]):
            y, x = np.nonzero(labels == i)
            points_px = np.column_stack([x, y]).astype(np.float64) * _STEP_PX + 0.5
            seen = camera, points_px
            sigma, depth = sigma_depth_on(on[i], *seen) if i in on else sigma_depth(planes[i], *seen)
            known = planes[i].observable & (sigma < depth)
            owners.append(np.full(len(x), i))
            distances.append(depth * np.linalg.norm(camera.rays_world(points_px), axis=1))
            shares.append(np.where(known, sigma / depth, 1.0))
    return DrawnPixels(np.concatenate(owners), np.concatenate(distances), np.concatenate(shares))
