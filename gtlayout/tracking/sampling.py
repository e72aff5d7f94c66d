"""Points worth following, spread over the visible parts of elements (paper 3.2)."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.raster import fill, rings_of
from gtlayout.scene import BoolArray, Element, FloatArray, ImageArray
from gtlayout.tracking.config import TrackingConfig
from gtlayout.tracking.sobol import sobol_points

_AROUND = 4
"""Pixels beyond the window of the corner measure that it depends on: gradients, and neighbours that may be greater."""
_ALIGNED = 64
"""Steps of the borders of what is looked at: OpenCV computes whole vectors of pixels, and their rests otherwise."""


def sampled_region(element: Element, config: TrackingConfig) -> BaseGeometry:
    """The part of the image, px, in which points of an element are sampled: its visible parts without their border.

    An element without visible parts is sampled on its eroded amodal polygon.
    """
    region = element.visible.buffer(-config.border_px)
    return element.amodal.buffer(-config.spacing_px / 2) if region.is_empty else region


def sample_points(image: ImageArray, element: Element, config: TrackingConfig, seed: int) -> FloatArray:
    """(N, 2) corners spread over the ``sampled_region`` of an element by a Sobol sequence (paper 3.2).

    A cell round each of area / spacing² Sobol points gives its best corners. Deterministic in ``seed``.
    """
    height, width = image.shape
    region = sampled_region(element, config)
    if region.is_empty:
        return np.empty((0, 2))
    mask = fill(rings_of(MultiPolygon([region]) if region.geom_type == "Polygon" else region), height, width)
    corners_px = _corners(image, mask, config)
    if len(corners_px) == 0:
        return np.empty((0, 2))
    wanted = min(max(1, round(region.area / config.spacing_px**2)), config.max_cells)
    left, top, right, bottom = region.bounds
    # Sobol points fill the bounding box; those inside the region are its even cover.
    total = min(max(1, round(wanted * (right - left) * (bottom - top) / region.area)), 1 << 16)
    unit = sobol_points(total, seed)
    seeds = np.array([left, top]) + unit * np.array([right - left, bottom - top])
    inside = mask[np.clip(seeds[:, 1].astype(int), 0, height - 1), np.clip(seeds[:, 0].astype(int), 0, width - 1)]
    seeds = seeds[inside] if inside.any() else corners_px[:1]
    # goodFeaturesToTrack returns corners best first: a stable ranking inside each seed's cell.
    cell = np.asarray(cKDTree(seeds).query(corners_px)[1])
    order = np.argsort(cell, kind="stable")
    sizes = np.bincount(cell, minlength=len(seeds))
    rank = np.arange(len(cell)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    chosen: FloatArray = corners_px[np.sort(order[rank < config.corners_per_cell])]
    return chosen


def _corners(image: ImageArray, mask: BoolArray, config: TrackingConfig) -> FloatArray:
    """(N, 2) corners within the (H, W) mask, px, best first; looked for around it only."""
    rows, columns = (np.nonzero(mask.any(axis=axis))[0] for axis in (1, 0))
    if len(rows) == 0:
        return np.empty((0, 2))
    low = [max(0, at[0] - config.corner_block_px - _AROUND) // _ALIGNED * _ALIGNED for at in (rows, columns)]
    high = [-(-(at[-1] + config.corner_block_px + _AROUND) // _ALIGNED) * _ALIGNED for at in (rows, columns)]
    around = np.s_[low[0] : high[0], low[1] : high[1]]
    corners = cv2.goodFeaturesToTrack(
        np.ascontiguousarray(image[around]),
        maxCorners=0,
        qualityLevel=config.corner_quality,
        minDistance=config.corner_distance_px,
        mask=mask[around].astype(np.uint8),
        blockSize=config.corner_block_px,
    )
    if corners is None:
        return np.empty((0, 2))
    found: FloatArray = corners.reshape(-1, 2).astype(np.float64) + np.array([low[1] + 0.5, low[0] + 0.5])
    return found


def texture_sigma_px(image: ImageArray, points_px: FloatArray, config: TrackingConfig) -> FloatArray:
    """(N,) σ of a match at each point: errors of calibration, and image noise over the weaker gradient of the
    patch.
    """
    strength = cv2.cornerMinEigenVal(image, config.corner_block_px)
    column, row = np.floor(points_px).astype(int).T
    weaker_gradient = np.maximum(strength[row, column].astype(np.float64), 1e-12)
    return np.sqrt(config.sigma_px**2 + config.weak_texture / weaker_gradient)
