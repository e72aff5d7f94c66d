"""Making a scene metric: how many metres its unit is, from measured depth or from one known distance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import cv2
import numpy as np
import numpy.typing as npt

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import path_inside
from gtlayout.io.pixels.images import MM_PER_UNIT, SATURATED, decode
from gtlayout.scene import BoolArray, FloatArray

if TYPE_CHECKING:
    import pycolmap

MIN_POINTS = 30
"""Least number of points with a measured depth."""
MAX_SPREAD = 0.2
"""Depth and points that differ by more, whatever the scale (σ, as a share), are not of one scene."""
MAX_JUMP = 0.05
"""Where a depth map changes by more from one pixel to the next, an edge lies: a point there has either depth."""
MAX_ASPECT_ERROR = 0.03
"""A depth map of another shape than its image has another field of view."""
SIGMA_OF_MAD = 1.4826
SIGMA_OF_MEDIAN = math.sqrt(math.pi / 2)
"""The median's standard error, in those of the mean."""


@dataclass(frozen=True)
class Scale:
    """Metres in a unit of the scene."""

    factor: float
    sigma_share: float
    """σ of ``factor``, as a share of it."""
    how: str
    """What it was found from, one line."""


@dataclass(frozen=True)
class SparseDepths:
    """The points of a model that one image sees."""

    name: str
    width: int
    """Of the image, px."""
    height: int
    points_px: FloatArray
    """(N, 2) where it sees them, in the image file."""
    depths: FloatArray
    """(N,) along the camera's z, world unit."""


def sparse_depths(model: pycolmap.Reconstruction) -> tuple[SparseDepths, ...]:
    """Pixels and depths of the points that each posed image of a COLMAP model sees, in order of its names."""
    found = []
    for image in sorted(model.images.values(), key=lambda each: each.name):
        seen = [point for point in image.points2D if point.has_point3D()] if image.has_pose else []
        if not seen:
            continue
        points_world = np.array([model.points3D[point.point3D_id].xyz for point in seen])
        depths = points_world @ image.cam_from_world().matrix()[2, :3] + image.cam_from_world().matrix()[2, 3]
        points_px = np.array([point.xy for point in seen])
        found.append(SparseDepths(image.name, image.camera.width, image.camera.height, points_px, depths))
    return tuple(found)


def scale_from_depth(observations: Sequence[SparseDepths], path: Path) -> Scale:
    """The scale at which the points' depths are those that ``path`` measured.

    ``path`` is one depth map, named like its frame (another suffix), or a folder of such: 16-bit PNG, millimetres along
    z, 0 and 65535 = none, of any size with the image's field of view. The scale is the median ratio over all points;
    its σ comes from the ratios' median absolute deviation and from how far maps differ from one another.
    Raises GtlayoutError when no map is there or none fits a frame, or they are too few or disagree.
    """
    if not observations:
        raise GtlayoutError(
            "metric scale from depth needs a COLMAP model with points that its images see; "
            "give a known distance instead"
        )
    ratios = [_log_ratios(seen, depth_path) for seen, depth_path in _maps(observations, path)]
    every = np.concatenate(ratios)
    if len(every) < MIN_POINTS:
        raise GtlayoutError(
            f"{path}: only {len(every)} points of the model have a measured depth, {MIN_POINTS} are needed: "
            "give more depth maps, or denser ones"
        )
    spread = _spread(every)
    if spread > MAX_SPREAD:
        raise GtlayoutError(
            f"{path}: measured depth and the model differ by {spread:.0%} whatever the scale: "
            "are the maps millimetres along z, of these frames, with the images' field of view?"
        )
    medians = np.array([np.median(each) for each in ratios if len(each) >= MIN_POINTS])
    between = float(np.std(medians, ddof=1)) if len(medians) > 1 else 0.0
    sigma = math.hypot(SIGMA_OF_MEDIAN * spread / math.sqrt(len(every)), between / math.sqrt(max(len(medians), 1)))
    apart = f", which differ by {between:.1%}" if len(medians) > 1 else ""
    how = f"{len(every)} points with a depth in {sum(map(bool, map(len, ratios)))} depth maps{apart}"
    return Scale(math.exp(float(np.median(every))), sigma, how)


def _maps(observations: Sequence[SparseDepths], path: Path) -> list[tuple[SparseDepths, Path]]:
    """The frames that have a depth map, and where."""
    if path.is_dir():
        places = [
            path_inside(path, str(PurePosixPath(seen.name).with_suffix(".png")), seen.name) for seen in observations
        ]
        found = [(seen, place) for seen, place in zip(observations, places, strict=True) if place.is_file()]
        if not found:
            raise GtlayoutError(f"{path} holds no depth map for any frame; looked for {places[0].name} and so on")
        return found
    if not path.is_file():
        raise GtlayoutError(f"no depth map {path}")
    named = [seen for seen in observations if PurePosixPath(seen.name).stem == path.stem]
    if len(named) != 1:
        what = "no frame" if not named else f"{len(named)} frames"
        raise GtlayoutError(f"{path}: {what} with points called so; name it like its frame, as {observations[0].name}")
    return [(named[0], path)]


def _log_ratios(seen: SparseDepths, path: Path) -> FloatArray:
    """(M,) log of measured depth in metres over depth in scene units, where there is a measurement off edges."""
    raw = decode(path, cv2.IMREAD_UNCHANGED)
    if raw.dtype != np.uint16 or raw.ndim != 2:
        raise GtlayoutError(f"{path} is no depth map: 16-bit grey is expected")
    height, width = raw.shape
    if abs(math.log(width * seen.height / (height * seen.width))) > MAX_ASPECT_ERROR:
        raise GtlayoutError(
            f"{path}: {width}x{height} px, its image {seen.width}x{seen.height}: another shape, "
            "so another field of view"
        )
    depth_m = np.where(raw == SATURATED, 0, raw).astype(np.float32) / np.float32(MM_PER_UNIT)
    x, y = np.floor(seen.points_px * (width / seen.width, height / seen.height)).astype(np.int64).T
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height) & (seen.depths > 0)
    x, y, depths = x[inside], y[inside], seen.depths[inside]
    clear = _off_edges(depth_m)[y, x]
    return np.log(depth_m[y, x][clear].astype(np.float64) / depths[clear])


def _off_edges(depth_m: npt.NDArray[np.float32]) -> BoolArray:
    """(H, W): whether a pixel and its eight neighbours are measured, and nearly alike."""
    kernel = np.ones((3, 3), np.uint8)
    nearest, farthest = cv2.erode(depth_m, kernel), cv2.dilate(depth_m, kernel)
    return (nearest > 0) & (farthest <= (1 + 2 * MAX_JUMP) * nearest)


def _spread(values: FloatArray) -> float:
    """Robust σ."""
    return SIGMA_OF_MAD * float(np.median(np.abs(values - np.median(values))))
