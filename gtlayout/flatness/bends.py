"""How far the tracks of a surface bend, in four directions over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtlayout.flatness.config import FlatnessConfig
from gtlayout.geometry.rays import depth_on_plane, inverse_depth_on_plane, nonzero
from gtlayout.instances import Instance
from gtlayout.planes.evidence import prefer_visible
from gtlayout.scene import BoolArray, FloatArray, IntArray, Scene
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks

_DIRECTIONS = 4
_NORMAL_MEDIAN = 0.6745
"""Of the absolute value of a standard normal variable."""
_MEDIAN_SIGMA = 1.2533
"""σ of the median of normal values, as a multiple of that of their mean."""
_ENDS = (5.0, 95.0)
"""Percentiles of the cells between which a surface is measured: beyond lie a few."""


@dataclass(frozen=True)
class Bend:
    """How far a surface lies, amid a measuring distance, from the straight line between its ends. World unit."""

    deviation: float
    """Positive where it bulges into the room."""
    sigma: float
    distance: float

    def scaled(self, factor: float) -> Bend:
        """In a unit of which a world unit has so many."""
        return Bend(factor * self.deviation, factor * self.sigma, factor * self.distance)


@dataclass(frozen=True)
class _Cells:
    """Tracks of one key frame that are near to each other, together."""

    place: FloatArray
    """(C, 2) on the plane."""
    off: FloatArray
    """(C,) distance from the plane, towards the cameras."""
    sigma: FloatArray
    """(C,) of independent errors."""
    key_frame: IntArray
    """(C,)"""
    square: IntArray
    """(C,) number of the square that they lie in; that of one place is the same in all key frames."""


def bends(
    scene: Scene,
    instances: Sequence[Instance],
    planes: FloatArray,
    tracks: Tracks,
    rays: TriangulatedTracks,
    track_instance: IntArray,
    config: FlatnessConfig,
) -> tuple[tuple[Bend, ...], ...]:
    """Of each instance how far it bends, in each direction that its tracks cover; doors and windows are left out.

    A parabola is fitted to the tracks in each direction, robustly, over all of the surface that they cover. Place and
    tilt are fitted, too, so that it does not matter whether a plane is where its tracks are. Each key frame has an
    error of place, of tilt and of bend of its own: only what they agree on is a bend of the surface.

    Args:
        scene: Everything is in its world.
        instances: The instances.
        planes: (S, 4) theirs, NaN = not placed.
        tracks: Point tracks.
        rays: The same, triangulated.
        track_instance: (N,) instance of each, -1 = none.
        config: See there.
    """
    used = prefer_visible(scene, tracks, track_instance)
    # The one of a camera's axes that is longer along a plane gives it directions that turn with the scene.
    _, down, ahead = scene.frame_of(0).camera.R_cam_from_world
    found: list[tuple[Bend, ...]] = []
    for index, instance in enumerate(instances):
        own = np.nonzero(used == index)[0]
        if instance.host is not None or len(own) < config.min_tracks or not np.isfinite(planes[index]).all():
            found.append(())
            continue
        normal = planes[index, :3]
        first, second = (axis - (axis @ normal) * normal for axis in (down, ahead))
        axis = first if first @ first >= second @ second else second
        axis /= np.linalg.norm(axis)
        found.append(_bends(planes[index], np.stack([axis, np.cross(normal, axis)]), rays, own, tracks, config))
    return tuple(found)


def _bends(
    plane: FloatArray,
    axes: FloatArray,
    rays: TriangulatedTracks,
    own: IntArray,
    tracks: Tracks,
    config: FlatnessConfig,
) -> tuple[Bend, ...]:
    """Of one (4,) plane with (2, 3) axes, from the tracks ``own``."""
    facing = rays.ray[own] @ plane[:3]
    clearance = rays.center[own] @ plane[:3] + plane[3]
    depth = depth_on_plane(clearance, facing)
    share = 1 - rays.rho[own] / nonzero(inverse_depth_on_plane(clearance, facing))
    sigma_share = rays.sigma_rho[own] * np.abs(depth)
    good = (depth > 0) & (np.abs(facing) > config.min_facing)
    good &= (np.abs(share) < config.max_off) & (sigma_share < config.max_sigma)
    key_frames = len(np.unique(tracks.key_frame[own[good]]))
    if np.count_nonzero(good) < config.min_tracks or key_frames < config.min_key_frames:
        return ()
    own, facing, depth = own[good], facing[good], depth[good]
    place = (rays.center[own] + depth[:, None] * rays.ray[own]) @ axes.T
    # A smaller inverse depth lies deeper; the depth changes by as large a share.
    off, sigma = share[good] * depth * facing, sigma_share[good] * depth * np.abs(facing)
    noise = float(np.median(np.abs(off - np.median(off)) / sigma)) / _NORMAL_MEDIAN
    unit = float(np.median(depth))
    cells = _cells(place, off, min(noise, 1.0) * sigma, tracks.key_frame[own], config.cell * unit)
    measured = []
    for angle in np.pi / _DIRECTIONS * np.arange(_DIRECTIONS):
        along = cells.place @ np.array([np.cos(angle), np.sin(angle)])
        across = cells.place @ np.array([-np.sin(angle), np.cos(angle)])
        start, end = np.percentile(along, _ENDS)
        covered = (along >= start) & (along <= end)
        third = np.minimum((3 * (along[covered] - start) / (end - start)).astype(np.int64), 2)
        places = [len(np.unique(cells.square[covered][third == t])) for t in range(3)]
        if min(places) >= config.min_places:
            s, t = along - (start + end) / 2, across - np.median(across)
            measured.append(_fit(cells, covered, s, t, float(end - start), unit, config))
    return tuple(measured)


def _cells(place: FloatArray, off: FloatArray, sigma: FloatArray, key_frame: IntArray, size: float) -> _Cells:
    """The weighted medians of tracks in squares of a size."""
    squares = np.floor((place - place.min(axis=0)) / size).astype(np.int64)
    square = np.unique(squares, axis=0, return_inverse=True)[1].ravel()
    cell = np.unique(np.column_stack([key_frame, square]), axis=0, return_inverse=True)[1].ravel()
    weight = 1 / sigma**2
    total = np.bincount(cell, weight)
    middle = np.column_stack([np.bincount(cell, weight * along) / total for along in place.T])
    order = np.lexsort((off, cell))
    first = np.searchsorted(cell[order], np.arange(len(total)))
    upto = np.cumsum(weight[order])
    before = upto[first] - weight[order][first]
    median = off[order][np.searchsorted(upto, before + total / 2)]
    one = order[first]
    return _Cells(middle, median, _MEDIAN_SIGMA / np.sqrt(total), key_frame[one], square[one])


def _fit(
    cells: _Cells,
    used: BoolArray,
    along: FloatArray,
    across: FloatArray,
    length: float,
    unit: float,
    config: FlatnessConfig,
) -> Bend:
    """The parabola over a measuring distance, where (C,) places along and across it are given from its middle."""
    s, t = 2 * along[used] / length, 2 * across[used] / length
    of_surface = np.column_stack([np.ones(len(s)), s, t, s**2])
    key_frame, square = cells.key_frame[used], cells.square[used]
    of_key_frames = [of_surface * (key_frame == k)[:, None] for k in np.unique(key_frame)]
    of_places = square[:, None] == np.unique(square)
    rows = np.column_stack([of_surface, *of_key_frames, of_places])
    shared = np.array([*[config.sigma_shared] * 3, config.sigma_shared_bend])
    sigmas = np.concatenate([np.tile(shared, len(of_key_frames)), np.full(of_places.shape[1], config.sigma_place)])
    prior = np.diag(np.concatenate([np.zeros(4), (unit * sigmas) ** -2]))
    off, sigma = cells.off[used], np.hypot(cells.sigma[used], config.sigma_cell * unit)
    weight = sigma**-2
    for _ in range(config.rounds):
        information = (rows * weight[:, None]).T @ rows + prior
        residual = rows @ np.linalg.solve(information, rows.T @ (weight * off)) - off
        weight = (config.freedom + 1) / (config.freedom + (residual / sigma) ** 2) / sigma**2
    covariance = np.linalg.inv((rows * weight[:, None]).T @ rows + prior)
    bend = covariance[3] @ (rows.T @ (weight * off))
    # The parabola is higher at the ends than in the middle by its coefficient.
    return Bend(-float(bend), float(np.sqrt(covariance[3, 3])), length)
