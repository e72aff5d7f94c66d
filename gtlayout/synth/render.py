"""Ray casting of planar polygons: which surface a pixel's ray meets, how far away, and the anti-aliased picture.

A plane's inverse depth and its texture coordinates over depth are affine in the pixel, so a surface is cast by
evaluating one affine function over the pixels within its outline instead of building rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gtlayout.geometry.raster import fill
from gtlayout.scene import Camera, FloatArray, ImageArray, IntArray
from gtlayout.synth.surfaces import MIP_LEVELS, Surface
from gtlayout.synth.textures import TEXEL_M, Texture

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
        row = uv1_over_z(surface, camera)[2]
        surface_inverse_depth = (row[0] * x_px + row[2])[None, :] + (row[1] * y_px)[:, None]
        holes = [project_polygon(camera, hole) for hole in surface.holes_world]
        nearer = fill([ring * oversample - low for ring in (outline, *holes)], len(y_px), len(x_px))
        nearer &= surface_inverse_depth > inverse_depth[window] * _COPLANAR
        index[window][nearer] = number
        inverse_depth[window][nearer] = surface_inverse_depth[nearer]
    return Cast(index, np.where(index >= 0, 1 / inverse_depth, np.inf), oversample)


def shade(surfaces: tuple[Surface, ...], camera: Camera, hits: Cast) -> Texture:
    """(height, width, 3) BGR picture in grey levels: trilinear texture look-up, averaged over each pixel's samples."""
    width = hits.surface.shape[1]
    samples = np.zeros((hits.surface.size, 3), np.float32)
    surface_of = hits.surface.ravel().astype(np.int16)  # NumPy sorts 16 bits by radix, much faster than 64
    order = np.argsort(surface_of, kind="stable")
    bounds = np.searchsorted(surface_of[order], np.arange(len(surfaces) + 1))
    for number, surface in enumerate(surfaces):
        at = order[bounds[number] : bounds[number + 1]]
        if len(at) == 0:
            continue
        depth = hits.depth.ravel()[at].astype(np.float32)
        pixels = np.stack([at % width + 0.5, at // width + 0.5, np.full(len(at), hits.oversample)]).astype(np.float32)
        texels_per_metre = 1 / TEXEL_M
        uv_from_samples = uv1_over_z(surface, camera)[:2] * (texels_per_metre / hits.oversample)
        uv_texels = (uv_from_samples.astype(np.float32) @ pixels) * depth
        # A sample covers z³ / (f² · distance) of a plane: longer than wide where the view is oblique, the mean decides.
        distance = surface.normal @ camera.center_world + surface.d
        scale = texels_per_metre / (camera.K[0, 0] * hits.oversample * np.sqrt(distance))
        level = (1.5 * np.log2(depth) + np.log2(scale)).astype(np.float32)
        samples[at] = _look_up(surface.mipmaps, uv_texels, level)
    picture = cv2.resize(
        samples.reshape(*hits.surface.shape, 3), (camera.width, camera.height), interpolation=cv2.INTER_AREA
    )
    return picture.astype(np.float32)


def inverse_depth(surface: Surface, camera: Camera, points_px: FloatArray) -> FloatArray:
    """(N,) inverse depths along the camera's z of a surface's plane at (N, 2) px, 1/m."""
    row = uv1_over_z(surface, camera)[2]
    return points_px @ row[:2] + row[2]


def uv1_over_z(surface: Surface, camera: Camera) -> FloatArray:
    """(3, 3) matrix taking (x_px, y_px, 1) to (u, v, 1) / depth on the surface's plane."""
    axes_cam = surface.frame.axes @ camera.R_cam_from_world.T
    origin_cam = camera.R_cam_from_world @ surface.frame.origin + camera.t_cam_from_world
    return np.linalg.inv(camera.K @ np.column_stack([*axes_cam, origin_cam]))


def _look_up(mipmaps: tuple[ImageArray, ...], uv_texels: Texture, level: Texture) -> Texture:
    """Trilinear: (2, N) texel coordinates on the finest level and (N,) fractional levels → (N, 3)."""
    level = np.clip(level, 0, MIP_LEVELS - 1.001)
    finer = level.astype(np.int8)
    result = np.zeros((len(level), 3), np.float32)
    for number in range(MIP_LEVELS - 1):
        at = np.flatnonzero(finer == number)
        if len(at):
            uv = uv_texels[:, at] / np.float32(2**number)
            fine, coarse = _bilinear(mipmaps[number], uv), _bilinear(mipmaps[number + 1], uv * np.float32(0.5))
            coarse -= fine
            coarse *= (level[at] - number)[:, None]
            fine += coarse
            result[at] = fine
    return result


def _bilinear(texture: ImageArray, at: Texture) -> Texture:
    """(N, 3) values at (2, N) texel coordinates; OpenCV wants the look-up as an image, centres at whole numbers."""
    count = at.shape[1]
    rows = -(-count // _ROW)
    maps = np.zeros((2, rows * _ROW), np.float32)
    maps[:, :count] = at - np.float32(0.5)
    u, v = maps.reshape(2, rows, _ROW)
    values = cv2.remap(texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return values.reshape(-1, 3)[:count].astype(np.float32)
