"""A scene as somebody else would have it, and how its layout is judged where the truth is: in the original's world."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from shapely.affinity import scale as scaled

from gtlayout.geometry.strip import strip_of
from gtlayout.instances import Extent, Mesh, Plane, PlaneFrame
from gtlayout.layout import Layout
from gtlayout.scene import Camera, FloatArray, KeyFrame, Scene

Sources = Sequence[tuple[int, Sequence[int]]]
"""Of each key frame that is given: the original's key frame that it was, and which of its elements, in order."""


@dataclass(frozen=True)
class Similarity:
    """``X_given = scale · R X_original + t``. Not the program's own: who judges it must not share its mistakes."""

    scale: float = 1.0
    R: FloatArray = field(default_factory=lambda: np.eye(3))
    """(3, 3) rotation."""
    t: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) in units of the given world."""

    def camera(self, camera: Camera) -> Camera:
        """The camera of the original world in the given one."""
        rotation = camera.R_cam_from_world @ self.R.T
        return replace(
            camera, R_cam_from_world=rotation, t_cam_from_world=self.scale * camera.t_cam_from_world - rotation @ self.t
        )

    def camera_back(self, camera: Camera) -> Camera:
        """The inverse of ``camera``."""
        t_cam_from_world = (camera.t_cam_from_world + camera.R_cam_from_world @ self.t) / self.scale
        return replace(camera, R_cam_from_world=camera.R_cam_from_world @ self.R, t_cam_from_world=t_cam_from_world)

    def undone(self, layout: Layout, metric: bool) -> Layout:
        """A layout of the given world in the original one; without its mesh and dimensions."""
        planes = [self._plane(plane) for plane in layout.planes]
        extents = [self._extent(extent) for extent in layout.extents]
        return Layout(layout.instances, tuple(planes), tuple(extents), Mesh.empty(), metric)

    def _plane(self, plane: Plane) -> Plane:
        # About its own anchor, which moves along, a covariance is only turned and scaled.
        back = np.diag([0.0, 0.0, 0.0, 1 / self.scale])
        back[:3, :3] = self.R.T
        return replace(
            plane,
            normal=self.R.T @ plane.normal,
            d=float(plane.d + plane.normal @ self.t) / self.scale,
            covariance=back @ plane.covariance @ back.T,
            anchor=self.R.T @ (plane.anchor - self.t) / self.scale,
            sigma_depth_m=np.nan,
        )

    def _extent(self, extent: Extent) -> Extent:
        strip, shift = strip_of(extent), -self.R.T @ self.t / self.scale
        frame = (
            PlaneFrame(self.R.T @ (extent.frame.origin - self.t) / self.scale, extent.frame.axes @ self.R)
            if strip is None
            else strip.moved(1 / self.scale, self.R.T, shift)
        )
        region, unrefined = (
            scaled(of, 1 / self.scale, 1 / self.scale, origin=(0, 0)) for of in (extent.region, extent.unrefined)
        )
        return Extent(frame, region, unrefined)


SAME = Similarity()


@dataclass(frozen=True)
class Variant:
    """What the program is given, and what its layout is compared with."""

    given: Scene
    judge: Scene
    """The same key frames with the same elements in the same order, but drawn as in the original, with the original's
    depth maps and names; its cameras are those given, in the original's world."""
    true_cameras: tuple[Camera, ...]
    """One for each key frame of ``judge``, as they were before anybody spoiled them."""
    moved: Similarity = SAME
    """From the original's world to the given one."""


Makers = dict[str, Callable[[Path], Variant]]
"""Name of a variant → how to make it; files that it needs go to the folder."""


def variant(
    original: Scene,
    given: Scene,
    sources: Sources,
    cameras: Sequence[Camera] | None = None,
    moved: Similarity = SAME,
) -> Variant:
    """Pair a scene that is ``given`` with the ``original`` that it was made from.

    Args:
        sources: where its key frames and their elements come from.
        cameras: one for each frame of the original, through which the layout is judged; the original's when not given.
        moved: from the original's world to the given one.
    """
    key_frames = tuple(
        replace(original.key_frames[k], elements=tuple(original.key_frames[k].elements[e] for e in elements))
        for k, elements in sources
    )
    frames = original.frames if cameras is None else with_cameras(original, cameras).frames
    truly = tuple(original.frame_of(k).camera for k, _ in sources)
    return Variant(unaided(given), replace(original, frames=frames, key_frames=key_frames), truly, moved)


def unaided(scene: Scene) -> Scene:
    """The scene without depth maps: they are for the judge."""
    return replace(scene, frames=tuple(replace(f, depth_path=None, register_depth=None) for f in scene.frames))


def with_cameras(scene: Scene, cameras: Iterable[Camera]) -> Scene:
    """The scene with another camera for each frame."""
    frames = zip(scene.frames, cameras, strict=True)
    return replace(scene, frames=tuple(replace(frame, camera=camera) for frame, camera in frames))


def all_drawn(scene: Scene) -> Sources:
    """All key frames with all their elements."""
    return [(k, range(len(key_frame.elements))) for k, key_frame in enumerate(scene.key_frames)]


def with_frames(scene: Scene, kept: Sequence[int]) -> Scene:
    """The scene with these of its frames, ascending; all key frames must be among them."""
    number = {frame: i for i, frame in enumerate(kept)}
    key_frames = tuple(replace(key_frame, frame=number[key_frame.frame]) for key_frame in scene.key_frames)
    return replace(scene, frames=tuple(scene.frames[i] for i in kept), key_frames=key_frames)


def with_key_frames(scene: Scene, kept: Sequence[int]) -> Scene:
    """The scene with these of its key frames, ascending."""
    return replace(scene, key_frames=tuple(scene.key_frames[k] for k in kept))


def redrawn(scene: Scene, key_frames: Mapping[int, KeyFrame]) -> Scene:
    """The scene with some key frames drawn anew, by their number."""
    redone = tuple(key_frames.get(k, key_frame) for k, key_frame in enumerate(scene.key_frames))
    return replace(scene, key_frames=redone)
