"""Polygons to pixel masks, sample points and label images.

A pixel belongs to a polygon when its centre lies inside: areas come out unbiased, which a silhouette measure needs
(drawing routines such as ``cv2.fillPoly`` also paint the outline and grow every polygon by about half a pixel).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from shapely import MultiPolygon, contains_xy, get_coordinates

from gtlayout.instances import Instance
from gtlayout.scene import OPENINGS, BoolArray, FloatArray, Scene

LabelImage = npt.NDArray[np.int32]


def rings_of(region: MultiPolygon) -> list[FloatArray]:
    """All rings of a region, outer and inner, each (N, 2) without the repeated last point."""
    rings = [ring for polygon in region.geoms for ring in (polygon.exterior, *polygon.interiors)]
    return [np.asarray(ring.coords, dtype=np.float64)[:-1, :2] for ring in rings]


def fill(rings: Sequence[FloatArray], height: int, width: int) -> BoolArray:
    """Even-odd fill: (height, width) mask of the pixels whose centre lies inside the rings ((N, 2) px, anywhere)."""
    if not rings:
        return np.zeros((height, width), dtype=bool)
    start = np.concatenate(rings)
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    # Rows whose centre line y = row + 0.5 an edge crosses: first <= row < last, half-open, so a vertex counts once.
    row_start, row_end = (np.clip(np.ceil(y - 0.5), 0, height).astype(np.int64) for y in (start[:, 1], end[:, 1]))
    first, last = np.minimum(row_start, row_end), np.maximum(row_start, row_end)
    edge = np.repeat(np.arange(len(start)), last - first)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(last - first) - (last - first), last - first) + first[edge]
    share = (row + 0.5 - start[edge, 1]) / (end[edge, 1] - start[edge, 1])
    x = start[edge, 0] + share * (end[edge, 0] - start[edge, 0])
    column = np.clip(np.ceil(x - 0.5), 0, width).astype(np.int64)
    inside = np.zeros((height, width), dtype=bool)
    if len(row):
        # Every crossing flips the row from its column on. Beyond the last one of all, all rows are outside.
        top, left = row.min(), column.min()
        rows, columns = row.max() - top + 1, column.max() - left + 1
        flips = np.bincount((row - top) * columns + column - left, minlength=rows * columns).astype(np.uint8)
        crossings = np.cumsum(flips.reshape(rows, columns), axis=1, dtype=np.uint8)
        inside[top : top + rows, left : left + columns] = (crossings & 1)[:, : width - left]
    return inside


def spread_points(region: MultiPolygon, count: int) -> FloatArray:
    """(N, 2) about ``count`` points of a regular grid inside a region (any unit), at least one."""
    left, top, right, bottom = region.bounds
    # Small pieces far apart would ask for a vast grid: so many lines each way are enough.
    step = max(np.sqrt(region.area / count), max(right - left, bottom - top) / (10 * count))
    x, y = np.meshgrid(np.arange(left + step / 2, right, step), np.arange(top + step / 2, bottom, step))
    inside = contains_xy(region, x, y)
    if not inside.any():
        return get_coordinates(region.representative_point())
    return np.column_stack([x[inside], y[inside]])


def annotated_labels(scene: Scene, instances: Sequence[Instance], k: int) -> LabelImage:
    """(H, W) instance of each pixel as drawn in key frame ``k``, -1 = none; doors and windows on top of their walls."""
    camera = scene.frame_of(k).camera
    labels: LabelImage = np.full((camera.height, camera.width), -1, dtype=np.int32)
    drawn = [(i, element) for i, instance in enumerate(instances) for frame, element in instance.members if frame == k]
    for i, element in sorted(drawn, key=lambda pair: instances[pair[0]].label in OPENINGS):
        amodal = scene.key_frames[k].elements[element].amodal
        labels[fill(rings_of(amodal), camera.height, camera.width)] = i
    return labels
