"""Visible parts of an element, proposed: where there is texture to track, and no track says that something hides it."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import shapely
from shapely import MultiPolygon

from gtlayout.annotate.shapes import tidy
from gtlayout.geometry.polygons import polygons
from gtlayout.geometry.raster import fill, rings_of
from gtlayout.io.annotations.masks import mask_polygons
from gtlayout.scene import FloatArray, ImageArray
from gtlayout.solution import Solution
from gtlayout.tracking.config import TrackingConfig

OUTVOTED = 0.1
"""A track whose weight is less lies on something else: what stands before the plane."""
TIDY_PX = 1.0
"""Proposed outlines are rough: they may move by so much to have few vertices."""


def textured_part(
    gray: ImageArray, region: MultiPolygon, before: MultiPolygon, off_plane_px: FloatArray, config: TrackingConfig
) -> MultiPolygon:
    """The part of a region (px) of a (H, W) image round its corners, without what stands ``before`` it.

    Corners are those that tracking would find, each with the ``config.spacing_px`` round it that it stands for.
    Corners next to tracks that lie off the plane, (N, 2) ``off_plane_px``, are left out.
    """
    height, width = gray.shape
    seen = polygons(region.difference(before).buffer(-config.border_px))
    if seen.is_empty:
        return seen
    mask = fill(rings_of(seen), height, width).astype(np.uint8)
    corners = cv2.goodFeaturesToTrack(
        gray,
        maxCorners=0,
        qualityLevel=config.corner_quality,
        minDistance=config.corner_distance_px,
        mask=mask,
        blockSize=config.corner_block_px,
    )
    if corners is None:
        return MultiPolygon()
    near = _discs(corners.reshape(-1, 2).astype(np.float64), config.spacing_px, height, width)
    off = _discs(off_plane_px - 0.5, config.spacing_px / 2, height, width)
    # Gaps between neighbouring corners are no wider than twice the spacing; smaller than a disc is chance.
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * round(config.spacing_px) + 1,) * 2)
    closed = cv2.morphologyEx(near, cv2.MORPH_CLOSE, kernel)
    textured = mask_polygons((closed > 0) & (off == 0) & (mask > 0))
    return tidy(polygons(shapely.simplify(textured, TIDY_PX)))


def off_plane_px(solution: Solution, frame: int) -> FloatArray:
    """(N, 2) px of the tracks that a frame sees and that were outvoted."""
    tracks, weight = solution.tracks, solution.estimate.landmark_weight
    in_frame = tracks.frame == frame
    outvoted = (solution.track_instance >= 0) & (weight < OUTVOTED)
    return tracks.points_px[in_frame & outvoted[tracks.track]]


def _discs(centers_px: FloatArray, radius_px: float, height: int, width: int) -> npt.NDArray[np.uint8]:
    image = np.zeros((height, width), dtype=np.uint8)
    for x, y in np.round(centers_px).astype(int).tolist():
        cv2.circle(image, (x, y), round(radius_px), 255, thickness=-1)
    return image
