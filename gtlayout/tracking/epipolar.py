"""Features of one image looked for in another along the known epipolar lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.geometry.polygons import homogeneous
from gtlayout.scene import Camera, FloatArray, IntArray
from gtlayout.tracking.features import Features

_SAME_PLACE_PX = 2.0
"""Two features of one image as near as this are one place, described twice. They are no rivals."""
_LEAST_DEPTH = 0.01
"""Only what lies in front of a camera is looked for: from this share of its depth in the other camera on."""
_TINY = 1e-12
_SINGLE_PX = 0.1
"""More than single precision loses in a distance of two points in an image."""
_AT_ONCE = 512
"""Pairs of descriptors."""
_DECIMALS = 9
"""To these decimals descriptors are equally far on every processor, for any order of summation."""


@dataclass(frozen=True)
class Segments:
    """The rays through N pixels of one camera, as another one sees them: a line segment each."""

    start_px: FloatArray
    """(N, 2) image of the far end."""
    along: FloatArray
    """(N, 2) unit direction to the near end."""
    length_px: FloatArray
    """(N,) -inf where the whole ray lies behind the camera."""

    @classmethod
    def of(cls, points_px: FloatArray, source: Camera, target: Camera, nearest: float) -> Segments:
        """The rays of ``source`` through (N, 2) ``points_px``, from depth ``nearest`` (world unit) to infinity."""
        far = source.rays_world(points_px) @ (target.K @ target.R_cam_from_world).T
        slope = target.K @ (target.R_cam_from_world @ source.center_world + target.t_cam_from_world)
        low, high = _in_front(far[:, 2], slope[2], 1.0 / nearest)
        seen = low < high
        # At inverse depth ρ the homogeneous image is far + ρ slope.
        ends = [far + np.where(seen, rho, 0.0)[:, None] * slope for rho in (low, high)]
        start_px, end_px = (end[:, :2] / np.where(seen, end[:, 2], 1.0)[:, None] for end in ends)
        length_px = np.linalg.norm(end_px - start_px, axis=1)
        along = np.where(
            length_px[:, None] > _TINY, (end_px - start_px) / np.maximum(length_px, _TINY)[:, None], [1.0, 0.0]
        )
        return cls(start_px, along, np.where(seen, length_px, -np.inf))

    def near(self, points_px: FloatArray, tolerance_px: float) -> tuple[IntArray, IntArray]:
        """The pairs (segment, point) of all that are within ``tolerance_px`` of each other, sorted.

        Args:
            points_px: (M, 2) in the image that the segments lie in.
        """
        (x, y), (start_x, start_y) = self.along.T, self.start_px.T
        # Products of all segments with all points take most of the time: single precision narrows them down.
        lines = np.column_stack([-y, x, y * start_x - x * start_y]).astype(np.float32)
        distance = lines @ homogeneous(points_px).astype(np.float32).T
        candidate = np.flatnonzero(np.abs(distance, out=distance) < tolerance_px + _SINGLE_PX)
        segment, point = np.divmod(candidate, len(points_px))
        offset = points_px[point] - self.start_px[segment]
        aside = x[segment] * offset[:, 1] - y[segment] * offset[:, 0]
        forward = np.sum(self.along[segment] * offset, axis=1)
        inside = (forward > -tolerance_px) & (forward < self.length_px[segment] + tolerance_px)
        inside &= np.abs(aside) < tolerance_px
        return segment[inside], point[inside]


@dataclass(frozen=True)
class EpipolarMatcher:
    """Finds features of a key frame again in another frame."""

    nearest: float
    """Least depth of a point, world unit."""
    tolerance_sigmas: float
    """Largest distance of a match from its epipolar line, in σ of a position."""
    max_ratio: float
    """Largest distance of its descriptor, as a share of that of the second candidate on the line."""

    def __call__(
        self, key: Features, key_camera: Camera, wanted: IntArray, other: Features, camera: Camera, sigma_px: float
    ) -> tuple[IntArray, IntArray]:
        """Which of the ``wanted`` features of a key frame are which features of another frame.

        Candidates lie on the image of the feature's ray. The most alike is the match, if the second is clearly less
        alike, and if no other feature of the key frame that could be the same by the geometry is more alike to it.

        Returns:
            (n,) the wanted features that have a match, and (n,) the features that these are.
        """
        tolerance_px = self.tolerance_sigmas * sigma_px
        lines = Segments.of(key.points_px[wanted], key_camera, camera, self.nearest)
        row, column = lines.near(other.points_px, tolerance_px)
        distance = _distance(key, wanted[row], other, column)
        best, least, second = _two_best(len(wanted), row, column, distance, other.points_px)
        found = least < self.max_ratio * np.minimum(second, 1.0)
        index, partner = wanted[found], best[found]
        back = Segments.of(other.points_px[partner], camera, key_camera, self.nearest)
        row, column = back.near(key.points_px, tolerance_px)
        elsewhere = np.linalg.norm(key.points_px[index[row]] - key.points_px[column], axis=1) > _SAME_PLACE_PX
        row, column = row[elsewhere], column[elsewhere]
        rival = np.full(len(index), np.inf)
        np.minimum.at(rival, row, _distance(other, partner[row], key, column))
        mutual = least[found] < rival
        return index[mutual], partner[mutual]


def _in_front(far_z: FloatArray, slope_z: float, most: float) -> tuple[FloatArray, FloatArray]:
    """(N,) least and largest inverse depth, up to ``most``, at which a ray is seen; the least is not smaller where it
    never is.
    """
    low, high = np.zeros(len(far_z)), np.full(len(far_z), most)
    if abs(slope_z) < _TINY:
        return np.where(far_z > _LEAST_DEPTH, low, np.inf), high
    crossing = (_LEAST_DEPTH - far_z) / slope_z
    return (np.maximum(low, crossing), high) if slope_z > 0 else (low, np.minimum(high, crossing))


def _distance(a: Features, of_a: IntArray, b: Features, of_b: IntArray) -> FloatArray:
    """(n,) distances of the descriptors of features ``of_a`` of one image and ``of_b`` of another, pair by pair."""
    alike = np.empty(len(of_a))
    # So many at a time stay in the processor's cache.
    for start in range(0, len(alike), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        alike[part] = np.sum(a.descriptors[of_a[part]].astype(np.float64) * b.descriptors[of_b[part]], axis=1)
    return np.sqrt(np.maximum(2.0 - 2.0 * np.round(alike, _DECIMALS), 0.0))


def _two_best(
    count: int, row: IntArray, column: IntArray, distance: FloatArray, points_px: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """For each of ``count`` rows the nearest column, its distance, and that of the nearest one in another place."""
    order = np.lexsort((column, distance, row))
    row, column, distance = row[order], column[order], distance[order]
    rows, first = np.unique(row, return_index=True)
    best, least, second = np.zeros(count, dtype=np.int64), np.full(count, np.inf), np.full(count, np.inf)
    best[rows], least[rows] = column[first], distance[first]
    elsewhere = np.linalg.norm(points_px[column] - points_px[best[row]], axis=1) > _SAME_PLACE_PX
    np.minimum.at(second, row[elsewhere], distance[elsewhere])
    return best, least, second
