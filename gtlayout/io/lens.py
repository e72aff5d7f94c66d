"""A lens as COLMAP describes it; pycolmap is imported only where there is a distortion to compute."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from gtlayout.extras import needs
from gtlayout.scene import FloatArray

if TYPE_CHECKING:
    import pycolmap

PARAMETERS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "FOV": ("fx", "fy", "cx", "cy", "omega"),
    "SIMPLE_RADIAL_FISHEYE": ("f", "cx", "cy", "k"),
    "RADIAL_FISHEYE": ("f", "cx", "cy", "k1", "k2"),
    "THIN_PRISM_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        *("fx", "fy", "cx", "cy", "k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"),
    ),
    "SIMPLE_DIVISION": ("f", "cx", "cy", "k"),
    "DIVISION": ("fx", "fy", "cx", "cy", "k"),
    "SIMPLE_FISHEYE": ("f", "cx", "cy"),
    "FISHEYE": ("fx", "fy", "cx", "cy"),
    "EUCM": ("fx", "fy", "cx", "cy", "alpha", "beta"),
    "EQUIRECTANGULAR": ("w", "h"),
}
"""COLMAP's models, in the order of their numbers from 0 on, and their parameters (COLMAP, sensor/models.h)."""
PINHOLE_MODELS = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"),
    *("SIMPLE_DIVISION", "DIVISION"),
)
"""Models that are a pinhole when their coefficients are zero; a fisheye or a panorama never is, though COLMAP calls
it undistorted then."""
_NO_DISTORTION = 1e-8
"""COLMAP takes no larger coefficient for zero."""


@dataclass(frozen=True)
class Lens:
    """One of COLMAP's models with its parameters; pixel centres at +0.5. Hashable."""

    model: str
    width: int
    """Of its images, px."""
    height: int
    params: tuple[float, ...]
    """As many as ``PARAMETERS[model]`` names, px or coefficients."""

    @property
    def focal_px(self) -> FloatArray:
        """(1,) f or (2,) fx, fy; (0,) of a panorama."""
        return self._of("f", "fx", "fy")

    @property
    def principal_px(self) -> FloatArray:
        """(2,) cx, cy; (0,) of a panorama."""
        return self._of("cx", "cy")

    @property
    def is_pinhole(self) -> bool:
        """Whether its images have no distortion."""
        coefficients = self.params[len(self.focal_px) + 2 :]
        return self.model in PINHOLE_MODELS and all(abs(value) <= _NO_DISTORTION for value in coefficients)

    @property
    def K(self) -> FloatArray:
        """(3, 3) intrinsics, px, of a lens that has a focal length."""
        (fx, fy), (cx, cy) = np.broadcast_to(self.focal_px, 2), self.principal_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @cached_property
    def colmap(self) -> pycolmap.Camera:
        """The same in pycolmap. Raises MissingExtraError where that is not installed."""
        pycolmap = pycolmap_for(f"the lens model {self.model}")
        return pycolmap.Camera(model=self.model, width=self.width, height=self.height, params=list(self.params))

    def rescaled(self, width: int, height: int) -> Lens:
        """The same lens for images of another size, px; its one focal length goes with the mean of both sides."""
        x, y = width / self.width, height / self.height
        by = {"f": (x + y) / 2, "fx": x, "cx": x, "w": x, "fy": y, "cy": y, "h": y}
        params = zip(self.params, PARAMETERS[self.model], strict=True)
        return Lens(self.model, width, height, tuple(value * by.get(name, 1.0) for value, name in params))

    def rays(self, points_px: FloatArray) -> FloatArray:
        """(N, 2) pixels → (N, 2) x/z, y/z in the camera; NaN where there is no inverse.

        Raises MissingExtraError where pycolmap is needed for a distortion and not installed.
        """
        if self.is_pinhole:
            return (points_px - self.principal_px) / self.focal_px
        return np.asarray(self.colmap.cam_from_img(points_px), dtype=np.float64)

    def _of(self, *names: str) -> FloatArray:
        params = zip(self.params, PARAMETERS[self.model], strict=True)
        return np.array([value for value, name in params if name in names])


def pycolmap_for(what: str) -> ModuleType:
    """The module pycolmap. Raises MissingExtraError, which says that ``what`` needs it, where it is not installed."""
    with needs("colmap", what):
        import pycolmap
    return pycolmap
