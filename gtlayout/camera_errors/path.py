"""All cameras of a video as arrays, so that an error they share is a function of the whole path."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from gtlayout.geometry.similarity import Similarity
from gtlayout.scene import FloatArray, IntArray, Scene


@dataclass(frozen=True)
class CameraPath:
    """Cameras of F frames, in the order of the video."""

    R_cam_from_world: FloatArray
    """(F, 3, 3) rotations."""
    centers_world: FloatArray
    """(F, 3) camera centres, world unit."""
    K: FloatArray
    """(F, 3, 3) intrinsics, px."""
    widths_px: FloatArray
    """(F,) of the images."""

    @classmethod
    def of(cls, scene: Scene, world: Similarity | None = None) -> Self:
        """The given cameras of a scene, in another world where one is named."""
        cameras = [world.camera(frame.camera) if world else frame.camera for frame in scene.frames]
        return cls(
            np.array([camera.R_cam_from_world for camera in cameras]),
            np.array([camera.center_world for camera in cameras]),
            np.array([camera.K for camera in cameras]),
            np.array([camera.width for camera in cameras], dtype=np.float64),
        )

    def __len__(self) -> int:
        return len(self.K)

    def at(self, frames: IntArray) -> CameraPath:
        """The cameras of some frames."""
        return CameraPath(
            self.R_cam_from_world[frames], self.centers_world[frames], self.K[frames], self.widths_px[frames]
        )

    def on(self, scene: Scene) -> Scene:
        """The scene with these cameras."""
        frames = tuple(
            replace(frame, camera=replace(frame.camera.placed(R, center), K=K))
            for frame, R, center, K in zip(scene.frames, self.R_cam_from_world, self.centers_world, self.K, strict=True)
        )
        return replace(scene, frames=frames)

    def change_to(self, other: CameraPath) -> FloatArray:
        """(F, 9) how each camera differs from that of another path, as ``reprojection.DIMENSIONS`` has it."""
        turns = Rotation.from_matrix(other.R_cam_from_world @ self.R_cam_from_world.transpose(0, 2, 1)).as_rotvec()
        return np.column_stack(
            [
                turns,
                other.centers_world - self.centers_world,
                np.log(other.K[:, 0, 0] / self.K[:, 0, 0]),
                other.K[:, :2, 2] - self.K[:, :2, 2],
            ]
        )
