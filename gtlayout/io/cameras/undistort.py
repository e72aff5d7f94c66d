"""Removing lens distortion: one pinhole camera per lens, and maps to it for pixels and points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pycolmap

from gtlayout.errors import GtlayoutError
from gtlayout.scene import FloatArray

PINHOLE_MODELS = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"),
    *("SIMPLE_DIVISION", "DIVISION"),
)
"""Models that are a pinhole when their coefficients are zero; a fisheye or a panorama never is, though COLMAP calls
it undistorted then."""


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
    def source(self) -> pycolmap.Camera:
        """The lens."""
        return pycolmap.Camera(model=self.model, width=self.width, height=self.height, params=list(self.params))

    @cached_property
    def target(self) -> pycolmap.Camera:
        """The pinhole camera; its size differs from the source's by what had to be cut off."""
        return pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(), self.source)

    def points(self, points_px: FloatArray) -> FloatArray:
        """(N, 2) pixels of the distorted image → (N, 2) pixels of the pinhole one; NaN where there is no inverse."""
        rays = np.asarray(self.source.cam_from_img(points_px), dtype=np.float64)
        K = self.target.calibration_matrix()
        return rays @ K[:2, :2].T + K[:2, 2]

    def distorted(self, points_px: FloatArray) -> FloatArray:
        """The inverse of ``points``: (N, 2) pixels of the pinhole image → (N, 2) of the distorted one."""
        K = self.target.calibration_matrix()
        rays = np.column_stack([(points_px - K[:2, 2]) / np.diag(K)[:2], np.ones(len(points_px))])
        return np.asarray(self.source.img_from_cam(rays), dtype=np.float64)

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


def undistortion(camera: pycolmap.Camera) -> Undistortion | None:
    """The undistortion a camera needs; None when it is a pinhole already.

    Raises GtlayoutError when the model has no pinhole counterpart (panoramas).
    """
    if camera.model_name in PINHOLE_MODELS and camera.is_undistorted():
        return None
    found = Undistortion(camera.model_name, camera.width, camera.height, tuple(float(p) for p in camera.params))
    try:
        _ = found.target
    except ValueError as error:
        raise GtlayoutError(f"camera model {camera.model_name} cannot be undistorted to a pinhole camera") from error
    return found


@lru_cache(maxsize=4)
def _maps(lens: Undistortion) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """OpenCV maps, (H, W) each: where in the source each target pixel lies, pixel centres at 0."""
    target = lens.target
    u, v = np.meshgrid(np.arange(target.width) + 0.5, np.arange(target.height) + 0.5)
    K = target.calibration_matrix()
    rays = np.column_stack([(u.ravel() - K[0, 2]) / K[0, 0], (v.ravel() - K[1, 2]) / K[1, 1], np.ones(u.size)])
    source_px = np.asarray(lens.source.img_from_cam(rays)).astype(np.float32) - np.float32(0.5)
    x, y = source_px.T.reshape(2, target.height, target.width)
    return np.ascontiguousarray(x), np.ascontiguousarray(y)
