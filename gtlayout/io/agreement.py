"""Do two camera files say the same of one video?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gtlayout.figures import short
from gtlayout.io.image_names import FilesOnDisk
from gtlayout.io.lens import Lens
from gtlayout.io.sources import PosedImage, on_disk
from gtlayout.scene import FloatArray

MIN_COMMON = 3
"""Images that two files must have in common to be compared: two poses fit any two others but for their rotations."""
MAX_RAY_SHARE = 0.02
"""Two calibrations of one lens differ by up to this share of the focal length, anywhere in the image."""
MAX_TURN_DEG = 1.0
MAX_MOVE_SHARE = 0.02
"""Of the camera's path; likewise for two sets of poses of one video, a similarity apart."""
STILL = 1e-9
"""Positions that differ by less, as a share of their size, are one."""
GRID = 5
"""Pixels each way at which lenses are compared."""

Key = tuple[Path, int]


def there(images: Sequence[PosedImage]) -> dict[Key, PosedImage]:
    """The images whose pixels are there, by what holds them: the file, or the video and the number of the frame."""
    return {
        (image.video.video.path, image.video.index) if image.video else (image.image_path.resolve(), -1): image
        for image in on_disk(images, FilesOnDisk())
        if image.is_there
    }


def contradiction(one: Sequence[PosedImage], other: Sequence[PosedImage]) -> str | None:
    """How two sets of cameras contradict each other, in words; None when they agree.

    They agree when the images they have in common (at least three) have the same intrinsics and, but for one similarity
    between their worlds, the same poses. Units and axes of worlds are anybody's choice.
    """
    a, b = there(one), there(other)
    common = [key for key in a if key in b]
    if len(common) < MIN_COMMON:
        return f"they have {len(common)} images in common"
    pairs = [(a[key], b[key]) for key in common]
    rays = max(_ray_difference(first.camera, second.camera) for first, second in pairs)
    if rays > MAX_RAY_SHARE:
        return f"their lenses differ by {100 * rays:.2g} % of the focal length"
    turn_deg, move_share = _pose_difference(pairs)
    if turn_deg > MAX_TURN_DEG:
        return f"their poses differ by up to {short(turn_deg)}°, whatever the axes of their worlds"
    if move_share > MAX_MOVE_SHARE:
        return f"their positions differ by up to {100 * move_share:.2g} % of the camera's path, whatever their units"
    return None


def _ray_difference(one: Lens, other: Lens) -> float:
    """Largest distance between the rays of a pixel, as a share of the focal length; images may differ in size."""
    share = (np.arange(GRID) + 0.5) / GRID
    grid = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
    a, b = (camera.rays(grid * (camera.width, camera.height)) for camera in (one, other))
    apart = np.linalg.norm(a - b, axis=1)
    return float(np.nanmax(apart)) if np.isfinite(apart).any() else np.inf


def _pose_difference(pairs: Sequence[tuple[PosedImage, PosedImage]]) -> tuple[float, float]:
    """Largest angle in degrees between rotations, and distance between centres as a share of the path, after the second
    world was turned, scaled and moved onto the first.
    """
    R_a, R_b = (np.array([pair[i].R_cam_from_world for pair in pairs]) for i in (0, 1))
    # The mean of what the rotations say of one world in the other: exact where they agree.
    u, _, vt = np.linalg.svd(np.einsum("nji,njk->ik", R_a, R_b))
    a_from_b = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    angles = np.linalg.norm(R_a - R_b @ a_from_b.T, axis=(1, 2)) / np.sqrt(8)
    turn_deg = float(np.rad2deg(2 * np.arcsin(np.clip(angles, 0, 1))).max())
    centers_a, centers_b = (_centred([pair[i] for pair in pairs]) for i in (0, 1))
    if not centers_a.any() or not centers_b.any():
        return turn_deg, float(centers_a.any() or centers_b.any())
    turned = centers_b @ a_from_b.T
    turned *= np.linalg.norm(centers_a) / np.linalg.norm(turned)
    path = float(np.linalg.norm(np.ptp(centers_a, axis=0)))
    return turn_deg, float(np.linalg.norm(centers_a - turned, axis=1).max()) / path


def _centred(images: Sequence[PosedImage]) -> FloatArray:
    """(N, 3) camera centres, with their mean as origin; 0 where they do not move but for rounding."""
    centers = np.array([-image.R_cam_from_world.T @ image.t_cam_from_world for image in images])
    still = np.ptp(centers, axis=0).max() <= STILL * np.abs(centers).max()
    return np.zeros_like(centers) if still else centers - centers.mean(axis=0)
