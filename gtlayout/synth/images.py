"""Effects of the camera: motion blur, exposure, noise."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gtlayout.scene import Camera, FloatArray, ImageArray
from gtlayout.synth.motion import CameraPath, drift
from gtlayout.synth.render import cast, shade
from gtlayout.synth.surfaces import Surface
from gtlayout.synth.textures import Texture

BLUR_STEP_PX = 1.5
"""Pictures that are averaged for motion blur are so far apart, where the image moves most; further, they would show."""
MAX_PICTURES = 16
BLUR_DEPTH_M = 1.5
"""Things nearer than this may show them all the same."""
EXPOSURE_FRAMES = 12
"""The exposure turns about once in so many frames."""
GAMMA = 2.2
"""Grey levels are light to the power of 1 / this."""


def cameras_along(path: CameraPath, K: FloatArray, width: int, height: int) -> tuple[Camera, ...]:
    """A camera with (3, 3) intrinsics ``K`` for each pose."""
    poses = zip(path.R_cam_from_world, path.centers_world, strict=True)
    return tuple(Camera(K, rotation, -rotation @ center, width, height) for rotation, center in poses)


def exposures(path: CameraPath, cameras: Sequence[Camera], shutter_share: float) -> tuple[tuple[Camera, ...], ...]:
    """The cameras to average for each of ``cameras`` along ``path``, which is in the middle of its exposure.

    ``shutter_share``: of the time from one frame to the next, the part in which the shutter is open; 0 = no blur.
    """
    if shutter_share == 0:
        return tuple((camera,) for camera in cameras)
    K, width, height = cameras[0].K, cameras[0].width, cameras[0].height
    frames = np.arange(len(cameras), dtype=np.float64)
    # Opening and closing of every shutter, one after another.
    ends = path.at(frames, (frames[:, None] + shutter_share * np.array([-0.5, 0.5])).ravel())
    moved_px = [_moved_px(*pair) for pair in pairwise(cameras_along(ends, K, width, height))][::2]
    counts = np.clip(np.ceil(np.array(moved_px) / BLUR_STEP_PX), 1, MAX_PICTURES).astype(int)
    # The middles of as many equal parts of the exposure.
    parts = [frame + shutter_share * ((np.arange(n) + 0.5) / n - 0.5) for frame, n in zip(frames, counts, strict=True)]
    during = cameras_along(path.at(frames, np.concatenate(parts)), K, width, height)
    firsts = np.cumsum(counts) - counts
    return tuple(
        during[first : first + count] if count > 1 else (camera,)
        for camera, first, count in zip(cameras, firsts, counts, strict=True)
    )


def picture(surfaces: tuple[Surface, ...], cameras: Sequence[Camera], oversample: int) -> Texture:
    """(height, width, 3) BGR grey levels, the mean of what the cameras see (of grey levels, not of light)."""
    mean = shade(surfaces, cameras[0], cast(surfaces, cameras[0], oversample))
    for camera in cameras[1:]:
        mean += shade(surfaces, camera, cast(surfaces, camera, oversample))
    return mean if len(cameras) == 1 else (mean / len(cameras)).astype(np.float32)


def gains(frames: int, sigma_ev: float, rng: np.random.Generator) -> FloatArray:
    """(frames,) factors of the grey levels for a smooth random exposure with σ in stops."""
    factors: FloatArray = 2.0 ** (sigma_ev * drift(frames, 1, EXPOSURE_FRAMES, rng)[:, 0] / GAMMA)
    return factors


def developed(light: Texture, gain: float, noise_sigma: float, rng: np.random.Generator) -> ImageArray:
    """The image file's pixels: exposed, with noise of σ grey levels, clipped."""
    noisy = (light * np.float32(gain) + rng.normal(0, noise_sigma, light.shape)).astype(np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _moved_px(start: Camera, end: Camera) -> float:
    """How far the image moves at most between two cameras."""
    grid = np.array([[x, y] for x in (0, 0.5, 1) for y in (0, 0.5, 1)]) * (start.width, start.height)
    points_world = start.center_world + BLUR_DEPTH_M * start.rays_world(grid)
    return float(np.linalg.norm(end.project(points_world)[0] - grid, axis=1).max())
