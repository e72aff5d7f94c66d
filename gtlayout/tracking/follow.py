"""Points followed from their key frame through the video, one way."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from gtlayout.scene import BoolArray, Camera, FloatArray, ImageArray, IntArray, Scene
from gtlayout.tracking.config import TrackingConfig
from gtlayout.tracking.image_cache import Images
from gtlayout.tracking.klt import PairTracker, lucas_kanade

_REMAP_ROWS = 1 << 14
"""Rows of one look-up: OpenCV's images have fewer than 2^15."""


def infinite_homography(source: Camera, target: Camera) -> FloatArray:
    """(3, 3) map of pixels between two cameras for points at infinity: ``K R K⁻¹`` of their relative rotation."""
    rotation = target.R_cam_from_world @ source.R_cam_from_world.T
    return target.K @ rotation @ np.linalg.inv(source.K)


def follow(
    scene: Scene,
    images: Images,
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
        anchor_px = _apply(key_turn, start_px[alive])[ok]
        anchored, anchor_ok = _match_key_patch(
            _warp(key_image, key_turn, next_camera), next_image, anchor_px, moved[ok], config
        )
        kept = anchor_ok & _inside(anchored, next_camera, config.border_px)
        alive, position = alive[ok][kept], anchored[kept]
        depths.add(alive, next_camera, position)
        camera, image = next_camera, next_image
        yield alive, np.full(len(alive), frame), position


class _InverseDepth:
    """Running least-squares inverse depth of each point along its ray in the key frame."""

    def __init__(self, key_camera: Camera, points_px: FloatArray) -> None:
        self._center = key_camera.center_world
        self._rays = key_camera.rays_world(points_px)
        # A point counts as infinitely far until it has moved by a pixel: noise without parallax is no prediction.
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
        """Add positions at which the points were seen."""
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


def _match_key_patch(
    key_image: ImageArray, image: ImageArray, anchor_px: FloatArray, moved_px: FloatArray, config: TrackingConfig
) -> tuple[FloatArray, BoolArray]:
    """Refine positions against the key frame's own patch (already turned into this view)."""
    refined, found = lucas_kanade(key_image, image, anchor_px, moved_px, config.window_px, 0)
    ok = found & (np.linalg.norm(refined - moved_px, axis=1) < config.max_patch_shift_px)
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
