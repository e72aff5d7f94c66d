"""Stage 1: sample points on the visible parts of each key frame and track them through the video (paper 3.2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import qmc
from shapely import MultiPolygon

from gtlayout.config import TrackingConfig
from gtlayout.errors import GtlayoutError
from gtlayout.geometry.raster import fill, rings_of
from gtlayout.image_cache import ImageCache
from gtlayout.klt import KltTracker, PairTracker, lucas_kanade
from gtlayout.scene import BoolArray, Camera, Element, FloatArray, ImageArray, IntArray, Scene

_REMAP_ROWS = 1 << 14
"""Rows of one look-up: OpenCV's images have fewer than 2^15."""


@dataclass(frozen=True)
class Tracks:
    """N point tracks with M observations in all; flat arrays, observations sorted by (track, frame)."""

    key_frame: IntArray
    """(N,) the key frame each point was sampled in."""
    element: IntArray
    """(N,) the element (index in that key frame) it was sampled on."""
    track: IntArray
    """(M,) which track an observation belongs to."""
    frame: IntArray
    """(M,) index into ``Scene.frames``."""
    points_px: FloatArray
    """(M, 2) position."""
    sigma_px: FloatArray
    """(N,) noise to expect of a point's positions: weak texture is matched less well."""
    tried: tuple[IntArray, ...]
    """Per key frame, (elements,) how many points were sampled on each element; few that survive mean a poor surface."""
    unreadable: tuple[str, ...] = ()
    """Names of the images that could not be read and were stepped over."""

    def __len__(self) -> int:
        return len(self.key_frame)


def track(
    scene: Scene,
    config: TrackingConfig,
    seed: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
    tracker: PairTracker | None = None,
) -> Tracks:
    """Sample points on every element of every key frame and follow them both ways through the video.

    Each step removes the known rotation before matching, predicts the rest from the depth seen so far, and re-anchors
    the result on the key frame's own patch, so that error does not add up along a track. A track ends at the first
    failure.

    Raises:
        GtlayoutError: an annotated image cannot be read.
    """
    tracker = tracker or KltTracker(config.window_px, config.levels, config.max_forward_backward_px)
    images = ImageCache(scene, config.max_frames)
    sampler = qmc.Sobol(d=2, seed=seed)
    key_frames, elements, sigmas, tried = [], [], [], []
    tracks, frames, points = [], [], []
    count = 0
    for k, key_frame in enumerate(scene.key_frames):
        progress(k, len(scene.key_frames))
        images.move_to(key_frame.frame)
        image = images(key_frame.frame)
        if image is None:
            raise GtlayoutError(f"{images.errors[key_frame.frame]}; it is annotated: mend it or remove its annotation")
        per_element = [sample_points(image, element, config, sampler) for element in key_frame.elements]
        tried.append(np.array([len(p) for p in per_element], dtype=np.int64))
        start = np.concatenate(per_element) if per_element else np.empty((0, 2))
        followed = [(np.arange(len(start)), np.full(len(start), key_frame.frame), start)]
        for direction in (-1, 1):
            followed += _follow(scene, images, k, start, direction, config, tracker)
        index, frame, position = (np.concatenate(part) for part in zip(*followed, strict=True))
        kept = np.bincount(index, minlength=len(start)) >= config.min_observations
        renumber = np.cumsum(kept) - 1 + count
        count += int(kept.sum())
        use = kept[index]
        tracks.append(renumber[index[use]])
        frames.append(frame[use])
        points.append(position[use])
        key_frames.append(np.full(int(kept.sum()), k))
        sigmas.append(texture_sigma_px(image, start[kept], config))
        elements.append(np.repeat(np.arange(len(per_element)), [len(p) for p in per_element])[kept])
    progress(len(scene.key_frames), len(scene.key_frames))
    track_index, frame_index = np.concatenate(tracks), np.concatenate(frames)
    order = np.lexsort((frame_index, track_index))
    return Tracks(
        key_frame=np.concatenate(key_frames),
        element=np.concatenate(elements),
        track=track_index[order],
        frame=frame_index[order],
        points_px=np.concatenate(points)[order],
        sigma_px=np.concatenate(sigmas),
        tried=tuple(tried),
        unreadable=tuple(scene.frames[frame].name for frame in sorted(images.errors)),
    )


def sample_points(image: ImageArray, element: Element, config: TrackingConfig, sampler: qmc.Sobol) -> FloatArray:
    """(N, 2) corners spread over the element's visible parts by a Sobol sequence (paper 3.2).

    A cell round each of area / spacing² Sobol points gives its best corners. An element without visible parts is
    sampled on its eroded amodal polygon.
    """
    height, width = image.shape
    region = element.visible.buffer(-config.border_px)
    if region.is_empty:
        region = element.amodal.buffer(-config.spacing_px / 2)
    if region.is_empty:
        return np.empty((0, 2))
    mask = fill(rings_of(MultiPolygon([region]) if region.geom_type == "Polygon" else region), height, width)
    corners = cv2.goodFeaturesToTrack(
        image,
        maxCorners=0,
        qualityLevel=config.corner_quality,
        minDistance=config.corner_distance_px,
        mask=mask.astype(np.uint8),
        blockSize=config.corner_block_px,
    )
    if corners is None:
        return np.empty((0, 2))
    corners_px = corners.reshape(-1, 2).astype(np.float64) + 0.5
    wanted = min(max(1, round(region.area / config.spacing_px**2)), config.max_cells)
    left, top, right, bottom = region.bounds
    sampler.reset()
    # Sobol points fill the bounding box; those inside the region are its even cover.
    total = min(max(1, round(wanted * (right - left) * (bottom - top) / region.area)), 1 << 16)
    unit = sampler.random(1 << (total - 1).bit_length())[:total]
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


def texture_sigma_px(image: ImageArray, points_px: FloatArray, config: TrackingConfig) -> FloatArray:
    """(N,) σ of a match at each point: what calibration leaves, and image noise over the weaker gradient of the
    patch.
    """
    strength = cv2.cornerMinEigenVal(image, config.corner_block_px)
    column, row = np.floor(points_px).astype(int).T
    weaker_gradient = np.maximum(strength[row, column].astype(np.float64), 1e-12)
    return np.sqrt(config.sigma_px**2 + config.weak_texture / weaker_gradient)


def infinite_homography(source: Camera, target: Camera) -> FloatArray:
    """(3, 3) map of pixels between two cameras for points at infinity: ``K R K⁻¹`` of their relative rotation."""
    rotation = target.R_cam_from_world @ source.R_cam_from_world.T
    return target.K @ rotation @ np.linalg.inv(source.K)


def _follow(
    scene: Scene,
    images: ImageCache,
    k: int,
    start_px: FloatArray,
    direction: int,
    config: TrackingConfig,
    tracker: PairTracker,
) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Yield (track, frame, position) of the points of key frame ``k`` that survive each frame in one direction."""
    key = scene.key_frames[k].frame
    key_camera, key_image = scene.frames[key].camera, images(key)
    assert key_image is not None
    depths = _InverseDepth(key_camera, start_px)
    alive, position = np.arange(len(start_px)), start_px
    camera, image = key_camera, key_image
    for step in range(1, config.max_frames + 1):
        frame = key + direction * step
        if not 0 <= frame < len(scene.frames) or alive.size == 0:
            return
        next_image = images(frame)
        if next_image is None:
            continue
        next_camera = scene.frames[frame].camera
        # The rotation between two frames is known: warping it away leaves only the parallax to the matcher, and the
        # depth seen so far predicts that.
        turn = infinite_homography(camera, next_camera)
        source_px = _apply(turn, position)
        parallax = depths.project(alive, next_camera) - _apply(turn, depths.project(alive, camera))
        moved, ok = tracker(_warp(image, turn, next_camera), next_image, source_px, source_px + parallax)
        key_turn = infinite_homography(key_camera, next_camera)
        anchor_px = _apply(key_turn, start_px[alive])
        anchored, anchor_ok = _re_anchor(_warp(key_image, key_turn, next_camera), next_image, anchor_px, moved, config)
        ok &= anchor_ok & _inside(anchored, next_camera, config.border_px)
        alive, position = alive[ok], anchored[ok]
        depths.add(alive, next_camera, position)
        camera, image = next_camera, next_image
        yield alive, np.full(len(alive), frame), position


class _InverseDepth:
    """Running least-squares inverse depth of each point along its ray in the key frame."""

    def __init__(self, key_camera: Camera, points_px: FloatArray) -> None:
        self._center = key_camera.center_world
        self._rays = key_camera.rays_world(points_px)
        # A point counts as infinitely far until it has moved by a pixel: noise without parallax predicts nothing.
        self._numerator = np.zeros(len(points_px))
        self._denominator = np.zeros(len(points_px))
        self._moved_px = np.zeros(len(points_px))

    def project(self, index: IntArray, camera: Camera) -> FloatArray:
        """(N, 2) pixels at which the points are expected."""
        rho = self._numerator[index] / np.maximum(self._denominator[index], 1e-12)
        rho = np.where(self._moved_px[index] > 1.0, rho, 0.0)
        homogeneous = self._homogeneous(index, camera, rho)
        return homogeneous[:, :2] / homogeneous[:, 2:]

    def add(self, index: IntArray, camera: Camera, points_px: FloatArray) -> None:
        """Take in where the points were seen."""
        far = self._homogeneous(index, camera, np.zeros(len(index)))
        slope = camera.K @ (camera.R_cam_from_world @ self._center + camera.t_cam_from_world)
        b = points_px - far[:, :2] / far[:, 2:]
        a = (slope[:2] - points_px * slope[2]) / far[:, 2:]
        self._numerator[index] += np.sum(a * b, axis=1)
        self._denominator[index] += np.sum(a * a, axis=1)
        self._moved_px[index] = np.maximum(self._moved_px[index], np.linalg.norm(b, axis=1))

    def _homogeneous(self, index: IntArray, camera: Camera, rho: FloatArray) -> FloatArray:
        direction = self._rays[index] @ camera.R_cam_from_world.T
        shift = camera.R_cam_from_world @ self._center + camera.t_cam_from_world
        return (direction + rho[:, None] * shift) @ camera.K.T


def _re_anchor(
    key_image: ImageArray, image: ImageArray, anchor_px: FloatArray, moved_px: FloatArray, config: TrackingConfig
) -> tuple[FloatArray, BoolArray]:
    """Refine positions against the key frame's own patch (already turned into this view)."""
    refined, found = lucas_kanade(key_image, image, anchor_px, moved_px, config.window_px, 0)
    ok = found & (np.linalg.norm(refined - moved_px, axis=1) < config.max_anchor_shift_px)
    ok[ok] = _correlation(key_image, image, anchor_px[ok], refined[ok], config.patch_px) > config.min_correlation
    return refined, ok


def _correlation(
    source: ImageArray, target: ImageArray, source_px: FloatArray, target_px: FloatArray, size_px: int
) -> FloatArray:
    """(N,) normalised cross-correlation of the square patches round two sets of points."""
    if len(source_px) == 0:
        return np.empty(0)
    span = np.arange(size_px) - (size_px - 1) / 2
    dx, dy = (grid.ravel() for grid in np.meshgrid(span, span))

    def patches(image: ImageArray, points_px: FloatArray) -> FloatArray:
        x = (points_px[:, :1] - 0.5 + dx).astype(np.float32)
        y = (points_px[:, 1:] - 0.5 + dy).astype(np.float32)
        parts = [
            cv2.remap(
                image, x[k : k + _REMAP_ROWS], y[k : k + _REMAP_ROWS], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            for k in range(0, len(x), _REMAP_ROWS)
        ]
        sampled = np.concatenate(parts).astype(np.float64)
        values = sampled - sampled.mean(axis=1, keepdims=True)
        return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-9)

    return np.sum(patches(source, source_px) * patches(target, target_px), axis=1)


def _warp(image: ImageArray, homography: FloatArray, camera: Camera) -> ImageArray:
    half = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    opencv_homography = np.linalg.inv(half) @ homography @ half
    size = (camera.width, camera.height)
    warped = cv2.warpPerspective(
        image, opencv_homography, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return warped.astype(np.uint8, copy=False)


def _apply(homography: FloatArray, points_px: FloatArray) -> FloatArray:
    homogeneous = np.column_stack([points_px, np.ones(len(points_px))]) @ homography.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


def _inside(points_px: FloatArray, camera: Camera, border_px: float) -> BoolArray:
    limit = np.array([camera.width, camera.height]) - border_px
    inside: BoolArray = np.all((points_px > border_px) & (points_px < limit), axis=1)
    return inside
