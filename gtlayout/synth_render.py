"""Ray casting of planar polygons: which surface a pixel's ray meets, how far away, and the anti-aliased picture.

A plane's inverse depth and its texture coordinates over depth are affine in the pixel, so a surface is cast by evaluating
one affine function over the pixels within its outline instead of building rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gtlayout.raster import fill
from gtlayout.scene import Camera, FloatArray, ImageArray, IntArray
from gtlayout.synth_room import MIP_LEVELS, Surface
from gtlayout.synth_textures import TEXEL_M

NEAR_M = 0.05
"""Surfaces nearer than this are cut away where outlines are projected."""
_COPLANAR = 1 - 1e-7
"""An opening drawn after its wall wins although rounding puts it a hair behind."""
_ROW = 1024


@dataclass(frozen=True)
class Cast:
    """What each sample's ray meets first; ``oversample`` samples per pixel and axis."""

    surface: IntArray
    """(height * oversample, width * oversample) index, -1 = nothing."""
    depth: FloatArray
    """The same shape, z in the camera, m; inf = nothing."""
    oversample: int


def project_polygon(camera: Camera, corners_world: FloatArray) -> FloatArray:
    """Project a polygon (N, 3), cut at the near plane. Returns (M, 2) px, empty when it lies behind the camera."""
    corners = corners_world @ camera.R_cam_from_world.T + camera.t_cam_from_world
    kept: list[FloatArray] = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if start[2] >= NEAR_M:
            kept.append(start)
        if (start[2] >= NEAR_M) != (end[2] >= NEAR_M):
            kept.append(start + (NEAR_M - start[2]) / (end[2] - start[2]) * (end - start))
    homogeneous = np.reshape(kept, (-1, 3)) @ camera.K.T
    projected: FloatArray = homogeneous[:, :2] / homogeneous[:, 2:]
    return projected


def faces_camera(surface: Surface, camera: Camera) -> bool:
    """True when the camera is on the side the surface's normal points to."""
    return float(surface.normal @ camera.center_world) + surface.d > 0


def cast(surfaces: tuple[Surface, ...], camera: Camera, oversample: int = 1) -> Cast:
    """Meet every sample's ray with the surfaces; the nearest wins, of coplanar ones the last."""
    shape = camera.height * oversample, camera.width * oversample
    index = np.full(shape, -1, np.int64)
    inverse_depth = np.full(shape, 1e-9)
    for number, surface in enumerate(surfaces):
        outline = project_polygon(camera, surface.corners_world) if faces_camera(surface, camera) else np.empty((0, 2))
        if len(outline) < 3:
            continue
        low = np.clip(np.floor(outline.min(axis=0) * oversample), 0, shape[::-1]).astype(int)
        high = np.clip(np.ceil(outline.max(axis=0) * oversample), 0, shape[::-1]).astype(int)
        if (high <= low).any():
            continue
        window = np.s_[low[1] : high[1], low[0] : high[0]]
        x_px = (np.arange(low[0], high[0]) + 0.5) / oversample
        y_px = (np.arange(low[1], high[1]) + 0.5) / oversample
        row = _uv1_over_z(surface, camera)[2]
        surface_inverse_depth = (row[0] * x_px + row[2])[None, :] + (row[1] * y_px)[:, None]
        nearer = fill([outline * oversample - low], len(y_px), len(x_px))
        nearer &= surface_inverse_depth > inverse_depth[window] * _COPLANAR
        index[window][nearer] = number
        inverse_depth[window][nearer] = surface_inverse_depth[nearer]
    return Cast(index, np.where(index >= 0, 1 / inverse_depth, np.inf), oversample)


def shade(surfaces: tuple[Surface, ...], camera: Camera, hits: Cast) -> FloatArray:
    """(height, width, 3) BGR picture in grey levels: trilinear texture look-up, averaged over each pixel's samples."""
    width = hits.surface.shape[1]
    samples = np.zeros((hits.surface.size, 3), np.float32)
    surface_of = hits.surface.ravel().astype(np.int16)  # 16 bits are sorted by radix, ten times faster
    order = np.argsort(surface_of, kind="stable")
    bounds = np.searchsorted(surface_of[order], np.arange(len(surfaces) + 1))
    for number, surface in enumerate(surfaces):
        at = order[bounds[number] : bounds[number + 1]]
        if len(at) == 0:
            continue
        pixels = np.stack(
            [(at % width + 0.5) / hits.oversample, (at // width + 0.5) / hits.oversample, np.ones(len(at))]
        )
        depth = hits.depth.ravel()[at]
        uv = (_uv1_over_z(surface, camera)[:2] @ pixels) * depth
        rays = camera.rays_world(pixels[:2].T)
        slant = np.abs(rays @ surface.normal) / np.linalg.norm(rays, axis=1)
        # A sample's footprint is longer than wide where the view is oblique: its geometric mean picks the level.
        footprint_m = depth / (camera.K[0, 0] * hits.oversample * np.sqrt(slant))
        samples[at] = _look_up(surface.mipmaps, uv / TEXEL_M, np.log2(footprint_m / TEXEL_M))
    blocks = samples.reshape(camera.height, hits.oversample, camera.width, hits.oversample, 3)
    return blocks.mean(axis=(1, 3), dtype=np.float64)


def _uv1_over_z(surface: Surface, camera: Camera) -> FloatArray:
    """(3, 3) matrix taking (x_px, y_px, 1) to (u, v, 1) / depth on the surface's plane."""
    axes_cam = surface.frame.axes @ camera.R_cam_from_world.T
    origin_cam = camera.R_cam_from_world @ surface.frame.origin + camera.t_cam_from_world
    return np.linalg.inv(camera.K @ np.column_stack([*axes_cam, origin_cam]))


def _look_up(mipmaps: tuple[ImageArray, ...], uv_texels: FloatArray, level: FloatArray) -> FloatArray:
    """Trilinear: (2, N) texel coordinates on the finest level and (N,) fractional levels → (N, 3)."""
    fine = np.clip(level, 0, MIP_LEVELS - 1 - 1e-6)
    coarse_share = (fine % 1)[:, None].astype(np.float32)
    result = np.zeros((uv_texels.shape[1], 3), np.float32)
    for number, texture in enumerate(mipmaps):
        for share, near in (
            (1 - coarse_share, fine.astype(int) == number),
            (coarse_share, fine.astype(int) == number - 1),
        ):
            at = np.flatnonzero(near)
            if len(at):
                result[at] += share[at] * _bilinear(texture, uv_texels[:, at] / 2**number - 0.5)
    return result


def _bilinear(texture: ImageArray, at: FloatArray) -> FloatArray:
    """(N, 3) values at (2, N) texel centres; OpenCV wants the look-up as an image."""
    count = at.shape[1]
    rows = -(-count // _ROW)
    padded = np.zeros((2, rows * _ROW), np.float32)
    padded[:, :count] = at
    maps = padded.reshape(2, rows, _ROW)
    values = cv2.remap(texture, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values.reshape(-1, 3)[:count], np.float32)
