"""Where an instance is drawn, as rays."""

from __future__ import annotations

from dataclasses import dataclass

from gtlayout.geometry.rays import depth_on_plane
from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class Views:
    """Where one instance is drawn: P sampled pixels as rays."""

    center: FloatArray
    """(P, 3) camera centres."""
    ray: FloatArray
    """(P, 3) directions with z = 1 in the camera."""

    def depths(self, planes: FloatArray) -> FloatArray:
        """(H, P) depths at which (H, 4) planes are seen there; negative behind the camera."""
        facing = planes[:, :3] @ self.ray.T
        return depth_on_plane(planes[:, :3] @ self.center.T + planes[:, 3:], facing)

    def seen_on(self, plane: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(Q, 3) points and (Q,) depths where a (4,) plane is seen at the pixels; Q ≤ P, 0 when it is seen at none."""
        depth = self.depths(plane[None])[0]
        seen = depth > 0
        return self.center[seen] + depth[seen, None] * self.ray[seen], depth[seen]
