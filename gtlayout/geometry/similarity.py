"""One world in terms of another: turned, moved, and with another unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.scene import Camera, FloatArray


@dataclass(frozen=True)
class Similarity:
    """``X_local = scale R (X_world - origin)``."""

    R: FloatArray
    """(3, 3) rotation."""
    origin: FloatArray
    """(3,) world."""
    scale: float
    """Local units in a world unit."""

    def camera(self, camera: Camera) -> Camera:
        """A camera of the world in the local one."""
        center = self.scale * (self.R @ (camera.center_world - self.origin))
        return camera.placed(camera.R_cam_from_world @ self.R.T, center)

    def camera_to_world(self, camera: Camera) -> Camera:
        """The inverse of ``camera``."""
        return camera.placed(camera.R_cam_from_world @ self.R, self.points_to_world(camera.center_world))

    def points(self, points_world: FloatArray) -> FloatArray:
        """(N, 3) points of the world in the local one."""
        return self.scale * ((points_world - self.origin) @ self.R.T)

    def points_to_world(self, points_local: FloatArray) -> FloatArray:
        """(..., 3) local points in the world."""
        return self.vectors_to_world(points_local) + self.origin

    def vectors_to_world(self, vectors_local: FloatArray) -> FloatArray:
        """(..., 3) differences of local points in the world."""
        return vectors_local @ self.R / self.scale

    def planes(self, planes_world: FloatArray) -> FloatArray:
        """(S, 4) planes of the world in the local one: the inverse of ``planes_to_world``."""
        normals = planes_world[:, :3] @ self.R.T
        return np.column_stack([normals, self.scale * (planes_world[:, :3] @ self.origin + planes_world[:, 3])])

    def planes_to_world(
        self, planes_local: FloatArray, anchor: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """(S, 4) local planes in the world, and the (4, 4) derivative of (normal, normal · anchor + d) there by
        (normal, d) here. Without an anchor, a (3,) world point, that is of (normal, d).
        """
        world = np.column_stack([planes_local[:, :3] @ self.R, planes_local[:, 3] / self.scale])
        world[:, 3] -= world[:, :3] @ self.origin
        jacobian = np.zeros((4, 4))
        jacobian[:3, :3] = self.R.T
        jacobian[3, :3] = self.R @ ((0.0 if anchor is None else anchor) - self.origin)
        jacobian[3, 3] = 1 / self.scale
        return world, jacobian


def covariance_by(covariance: FloatArray, jacobian: FloatArray) -> FloatArray:
    """(4S, 4S) covariance of S planes, propagated by the (4, 4) derivative of each plane's coefficients.

    Block by block, so that what is unknown of one plane, NaN, stays with it.
    """
    count = len(covariance) // 4
    blocks = covariance.reshape(count, 4, count, 4)
    return np.einsum("ab,sbtd,cd->satc", jacobian, blocks, jacobian).reshape(covariance.shape)
