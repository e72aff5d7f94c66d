"""Removing lens distortion: one pinhole camera per lens, and maps to it for pixels and points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gtlayout.errors import GtlayoutError
from gtlayout.io.lens import Lens, pycolmap_for
from gtlayout.scene import FloatArray

MIN_LEFT = 0.21
"""A lens that leaves less of its image is none: COLMAP's undistortion stops at 0.2 of its sides. Those of action
cameras leave 0.5 and more."""
_SAMPLES = 9
"""Of each side of the image."""


@dataclass(frozen=True)
class Undistortion:
    """From a distorted image to the pinhole one that COLMAP's undistortion would make (no blank pixels).

    Hashable, so that frames with the same lens share one pair of maps.
    """

    model: str
    width: int
    """Of the distorted image, px."""
    height: int
    params: tuple[float, ...]

    @cached_property
    def source(self) -> Lens:
        """The lens."""
        return Lens(self.model, self.width, self.height, self.params)

    @cached_property
    def target(self) -> Lens:
        """The pinhole camera; its size differs from the source's by what had to be cut off."""
        pycolmap = pycolmap_for(f"undistorting the lens model {self.model}")
        found = pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(), self.source.colmap)
        return Lens(found.model_name, found.width, found.height, tuple(float(value) for value in found.params))

    def points(self, points_px: FloatArray) -> FloatArray:
        """(N, 2) pixels of the distorted image → (N, 2) pixels of the pinhole one; NaN where there is no inverse."""
        K = self.target.K
        return self.source.rays(points_px) @ K[:2, :2].T + K[:2, 2]

    def distorted(self, points_px: FloatArray) -> FloatArray:
        """The inverse of ``points``: (N, 2) pixels of the pinhole image → (N, 2) of the distorted one."""
        K = self.target.K
        rays = np.column_stack([(points_px - K[:2, 2]) / np.diag(K)[:2], np.ones(len(points_px))])
        return np.asarray(self.source.colmap.img_from_cam(rays), dtype=np.float64)

    def __call__(self, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Resample an image, or a depth map: uint8 bilinearly, everything else by nearest neighbour.

        The camera's axes do not turn, so a depth along z stays as it is. Raises GtlayoutError on another size.
        """
        if image.shape[:2] != (self.height, self.width):
            raise GtlayoutError(f"{image.shape[1]}x{image.shape[0]} px, its camera says {self.width}x{self.height}")
        map_x, map_y = _maps(self)
        if image.dtype == np.uint8:
            return cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return cv2.remap(image, map_x, map_y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)


def undistortion(camera: Lens) -> Undistortion | None:
    """The undistortion a camera needs; None when it is a pinhole already.

    Raises GtlayoutError when the model has no pinhole counterpart (panoramas), MissingExtraError without pycolmap.
    """
    if camera.is_pinhole:
        return None
    found = Undistortion(camera.model, camera.width, camera.height, camera.params)
    try:
        _ = found.target
    except ValueError as error:
        raise GtlayoutError(f"camera model {camera.model} cannot be undistorted to a pinhole camera") from error
    if _left(found) < MIN_LEFT:
        raise GtlayoutError(
            f"the distortion of its lens, {camera.model} with {', '.join(f'{value:g}' for value in camera.params)}, "
            "leaves next to nothing of the image: correct the coefficients"
        )
    return found


@lru_cache(maxsize=16)
def _left(lens: Undistortion) -> float:
    """The share of the image's sides, or where that is less of its area, that a pinhole image can show."""
    x, y = np.meshgrid(np.linspace(0, lens.width, _SAMPLES), np.linspace(0, lens.height, _SAMPLES))
    inverse = np.isfinite(lens.points(np.column_stack([x.ravel(), y.ravel()]))).all(axis=1)
    return float(min(lens.target.width / lens.width, lens.target.height / lens.height, inverse.mean()))


@lru_cache(maxsize=4)
def _maps(lens: Undistortion) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """OpenCV maps, (H, W) each: where in the source each target pixel lies, pixel centres at 0."""
    target = lens.target
    u, v = np.meshgrid(np.arange(target.width) + 0.5, np.arange(target.height) + 0.5)
    K = target.K
    rays = np.column_stack([(u.ravel() - K[0, 2]) / K[0, 0], (v.ravel() - K[1, 2]) / K[1, 1], np.ones(u.size)])
    source_px = np.asarray(lens.source.colmap.img_from_cam(rays)).astype(np.float32) - np.float32(0.5)
    x, y = source_px.T.reshape(2, target.height, target.width)
    return np.ascontiguousarray(x), np.ascontiguousarray(y)
