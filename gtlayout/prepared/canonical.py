"""Before stage 1 and after stage 4: one form for all equivalent scenes.

The world's origin, its axes, its unit, the order of the elements and the first vertex of a polygon carry no information
about a room, so they must not change a result. Stages 1 to 4 work on the canonical form of a scene: origin amid the
cameras, axes of the first annotated camera, the diagonal of the box of all camera centres as unit, elements sorted by
label and place, no frame that only repeats the camera of its neighbour unless it is annotated. Their results are handed
back in the given world, with the frame and element indices of the given scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from gtlayout.geometry.similarity import Similarity
from gtlayout.instances import Instance
from gtlayout.scene import LABELS, Camera, Element, FloatArray, KeyFrame, Scene
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import camera_path

_SAME = 1e-9
"""Two cameras are the same up to this: radians, and shares of the camera's path."""
_DECIMALS = 3
"""Decimals of the pixels by which elements are sorted. Last digits, which differ between machines, do not matter."""
_FAR = 1e3
"""Where the world's origin is farther away than this multiple of the camera's path, covariances refer to a point amid
the cameras. Those of (normal, d) would lose the digits that σ is made of."""


@dataclass(frozen=True)
class Canonical:
    """A scene in canonical form, and the way back."""

    given: Scene
    scene: Scene
    """The same K key frames; possibly fewer frames."""
    similarity: Similarity
    same_camera_as: tuple[int, ...]
    """Of each given frame the given frame that stands for it here: itself, or one with the same camera."""
    elements: tuple[tuple[int, ...], ...]
    """Per key frame the index, in the given scene, of each element."""

    @property
    def anchor(self) -> FloatArray:
        """(3,) world point that covariances refer to: the world's origin, unless that is far away."""
        far = float(np.linalg.norm(self.similarity.origin)) * self.similarity.scale > _FAR
        return self.similarity.origin if far else np.zeros(3)

    def given_instances(self, instances: Sequence[Instance]) -> tuple[Instance, ...]:
        """Instances with the element indices of the given scene."""
        return tuple(
            replace(instance, members=tuple((k, self.elements[k][e]) for k, e in instance.members))
            for instance in instances
        )

    def given_tracks(self, tracks: Tracks) -> Tracks:
        """Tracks with the frame and element indices of the given scene."""
        offset = np.cumsum([0, *(len(order) for order in self.elements)])
        element = np.concatenate([np.array(order, dtype=np.int64) for order in self.elements])
        return replace(
            tracks,
            element=element[offset[tracks.key_frame] + tracks.element],
            frame=np.unique(self.same_camera_as)[tracks.frame],
            tried=tuple(
                tried[np.argsort(np.array(order, dtype=np.int64))]
                for tried, order in zip(tracks.tried, self.elements, strict=True)
            ),
        )

    def given_cameras(self, scene: Scene) -> Scene:
        """The given scene with the cameras of a canonical ``scene``."""
        numbers = np.searchsorted(np.unique(self.same_camera_as), self.same_camera_as)
        frames = tuple(
            replace(frame, camera=self.similarity.camera_to_world(scene.frames[number].camera))
            for frame, number in zip(self.given.frames, numbers, strict=True)
        )
        return replace(self.given, frames=frames)


def canonical(scene: Scene) -> Canonical:
    """The canonical form of a scene that has key frames."""
    return _in_form(scene, _similarity(scene), _same_camera_as(scene))


def redrawn(form: Canonical, scene: Scene) -> Canonical | None:
    """Another drawing of the scene of ``form`` in the same world, on the same frames; None where ``form`` lacks one."""
    if any(form.same_camera_as[key_frame.frame] != key_frame.frame for key_frame in scene.key_frames):
        return None
    return _in_form(scene, form.similarity, form.same_camera_as)


def _in_form(scene: Scene, similarity: Similarity, same_camera_as: tuple[int, ...]) -> Canonical:
    kept = sorted(set(same_camera_as))
    cameras = [similarity.camera(scene.frames[f].camera) for f in kept]
    if camera_path(scene) == 0.0:
        # A path of zero length up to rounding must stay zero.
        cameras = [camera.placed(camera.R_cam_from_world, np.zeros(3)) for camera in cameras]
    frames = tuple(replace(scene.frames[f], camera=camera) for f, camera in zip(kept, cameras, strict=True))
    key_frames, orders = [], []
    for key_frame in scene.key_frames:
        elements = [_normalised(element) for element in key_frame.elements]
        order = sorted(range(len(elements)), key=lambda e: _place(elements[e]))
        edges = sorted((_directed(line) for line in key_frame.occlusion_edges), key=lambda line: line.tolist())
        key_frames.append(KeyFrame(kept.index(key_frame.frame), tuple(elements[e] for e in order), tuple(edges)))
        orders.append(tuple(order))
    form = replace(scene, frames=frames, key_frames=tuple(key_frames))
    return Canonical(scene, form, similarity, same_camera_as, tuple(orders))


def _similarity(scene: Scene) -> Similarity:
    """Axes of the first annotated camera; origin and unit from the box, along these, that holds all camera centres."""
    R = scene.frame_of(0).camera.R_cam_from_world
    centers = np.array([frame.camera.center_world for frame in scene.frames]) @ R.T
    low, high = centers.min(axis=0), centers.max(axis=0)
    path = float(np.linalg.norm(high - low)) if camera_path(scene) else 1.0
    return Similarity(R, (low + high) / 2 @ R, 1 / path)


def _same_camera_as(scene: Scene) -> tuple[int, ...]:
    """Of each frame the one that stands for it: of frames in a row with one camera the first, or the annotated ones."""
    annotated = {key_frame.frame for key_frame in scene.key_frames}
    least = _SAME * camera_path(scene)
    runs: list[list[int]] = []
    for f, frame in enumerate(scene.frames):
        if runs and _same(scene.frames[runs[-1][0]].camera, frame.camera, least):
            runs[-1].append(f)
        else:
            runs.append([f])
    same_camera_as = []
    for run in runs:
        first = next((f for f in run if f in annotated), run[0])
        same_camera_as += [f if f in annotated else first for f in run]
    return tuple(same_camera_as)


def _same(a: Camera, b: Camera, least: float) -> bool:
    return (
        (a.width, a.height) == (b.width, b.height)
        and np.array_equal(a.K, b.K)
        and bool(np.linalg.norm(a.R_cam_from_world - b.R_cam_from_world) <= _SAME)
        and bool(np.linalg.norm(a.center_world - b.center_world) <= least)
    )


def _place(element: Element) -> tuple[object, ...]:
    """The key by which elements are sorted: label and place, not their ids or their order in the file."""
    shapes = (element.amodal, element.visible)
    return (
        LABELS.index(element.label),
        *(round(value, _DECIMALS) for shape in shapes for value in (shape.area, *shape.bounds)),
        *(shapely.get_coordinates(shape).tolist() for shape in shapes),
    )


def _normalised(element: Element) -> Element:
    """With rings that begin at a vertex, and run in a direction, that do not depend on how they were drawn."""
    return replace(element, amodal=shapely.normalize(element.amodal), visible=shapely.normalize(element.visible))


def _directed(line: FloatArray) -> FloatArray:
    return line if line[0].tolist() <= line[-1].tolist() else line[::-1]
