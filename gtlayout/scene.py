"""The plain data every stage takes: cameras, frames, key frames, annotated elements.

Conventions (``gtlayout.io`` converts everything to these when it is read):

* camera axes are OpenCV's (x right, y down, z forward); poses are ``cam_from_world``: ``X_cam = R X_world + t``;
* pixel (0, 0) is the top-left *corner* of the top-left pixel, so pixel centres lie at +0.5;
* cameras are pinhole: distortion is removed by the readers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt
import shapely
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.measurement import Measurement
from gtlayout.notebook import html_table

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
ImageArray = npt.NDArray[np.uint8]

Label = Literal["floor", "ceiling", "wall", "slanted", "door", "window"]
LABELS: tuple[Label, ...] = get_args(Label)
OPENINGS: frozenset[Label] = frozenset({"door", "window"})
"""Labels that lie in a host instance (usually a wall) instead of bounding the room themselves."""
SAME_BORDER_PX = 4.0
"""Lines that annotators draw for the two sides of one border differ by up to this, px of an image of 640x480. By
judgement, not measured: a pixel or two of either hand, and the error of the cameras."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with its pose."""

    K: FloatArray
    """(3, 3) intrinsics, px."""
    R_cam_from_world: FloatArray
    """(3, 3) rotation."""
    t_cam_from_world: FloatArray
    """(3,) translation, world unit."""
    width: int
    height: int

    @property
    def center_world(self) -> FloatArray:
        """(3,) camera centre in the world."""
        return -self.R_cam_from_world.T @ self.t_cam_from_world

    def placed(self, R_cam_from_world: FloatArray, center_world: FloatArray) -> Camera:
        """The same camera with another pose: (3, 3) rotation, and (3,) where its centre is in the world."""
        return replace(self, R_cam_from_world=R_cam_from_world, t_cam_from_world=-R_cam_from_world @ center_world)

    @property
    def annotation_scale(self) -> float:
        """Factor on an annotator's errors, in pixels, relative to an image of 640x480.

        A larger image is drawn on a screen of the same size. Annotators zoom into smaller ones, so it is at least 1.
        """
        return max(1.0, float(np.hypot(self.width, self.height)) / 800.0)

    def project(self, points_world: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Project (N, 3) world points. Returns (N, 2) pixels and (N,) depths (z in the camera)."""
        points_cam = points_world @ self.R_cam_from_world.T + self.t_cam_from_world
        homogeneous = points_cam @ self.K.T
        depth = points_cam[:, 2]
        return homogeneous[:, :2] / homogeneous[:, 2:], depth

    def rays_world(self, points_px: FloatArray) -> FloatArray:
        """(N, 3) world directions through (N, 2) pixels, scaled so that their z in the camera is 1.

        The world point at depth z is therefore ``center_world + z * ray``.
        """
        homogeneous = np.column_stack([points_px, np.ones(len(points_px))])
        return homogeneous @ self._ray_world_from_px

    @cached_property
    def _ray_world_from_px(self) -> FloatArray:
        """(3, 3) takes homogeneous pixels, as rows, to rays."""
        return np.linalg.inv(self.K).T @ self.R_cam_from_world


class VideoSource(Protocol):
    """A video file, read by ``gtlayout.io.pixels.video``."""

    path: Path

    @property
    def times_s(self) -> FloatArray:
        """(N,) presentation time of each frame, ascending, from the first frame on."""
        ...

    @property
    def width(self) -> int:
        """Of its frames, px."""
        ...

    @property
    def height(self) -> int:
        """Of its frames, px."""
        ...

    def frame(self, index: int) -> ImageArray:
        """(H, W, 3) uint8 BGR. Raises GtlayoutError when it cannot be decoded."""
        ...


@dataclass(frozen=True)
class VideoFrame:
    """One frame of a video file that stands in for an image file."""

    video: VideoSource
    """One object for all frames of a file."""
    index: int
    """In order of presentation, from 0 on."""


@dataclass(frozen=True)
class VideoOrigin:
    """Which frame of a video an image file was made of, however it was resampled since."""

    video_name: str
    """File name of the video."""
    number: int
    """Of the frame in the video, in order of presentation, from 0 on."""
    time_s: float
    """When the frame is shown, from the first frame on."""
    frame_count: int
    """Of the video."""
    resampled: Callable[[ImageArray], ImageArray] | None = None
    """What was done to the frame, as it is stored in the video, to make the image file of it; None = not known."""


@dataclass(frozen=True)
class Frame:
    """One video frame with a known camera."""

    name: str
    """The image's file name as the annotations call it."""
    image_path: Path
    """The image file; where ``video`` is given there is none, and this is only the name it would have."""
    camera: Camera
    undistort: Callable[[ImageArray], ImageArray] | None = None
    """Resamples the image file (or its depth map) to ``camera``; None when the file is pinhole already."""
    depth_path: Path | None = None
    """Depth along z in uint16 millimetres, 0 = none; None when the scene has no depth for this frame."""
    register_depth: Callable[[npt.NDArray[np.uint16]], npt.NDArray[np.uint16]] | None = None
    """Resamples the depth map, which has a camera of its own, to ``camera``; None when it is like the image file."""
    video: VideoFrame | None = None
    """Where the pixels are when there is no image file; read with ``gtlayout.io.pixels.images`` like any other."""
    origin: VideoOrigin | None = None
    """Where the image file is known to come from: what is drawn on that video belongs to this frame, too."""


@dataclass(frozen=True)
class Element:
    """What an annotator drew of one wall, floor, ceiling, slanted surface, door or window in one key frame."""

    id: str
    """The annotator's id: unique within its key frame, meaningless across frames."""
    label: Label
    amodal: MultiPolygon
    """Its whole outline within the image, drawn through furniture, px."""
    visible: MultiPolygon
    """Rough outlines of the textured parts that are seen, px; may be empty."""
    curved: bool = False
    """Whether the annotator says that it is curved; only of walls."""


@dataclass(frozen=True)
class KeyFrame:
    """The annotation of one frame."""

    frame: int
    """Index into ``Scene.frames``."""
    elements: tuple[Element, ...]
    occlusion_edges: tuple[FloatArray, ...] = ()
    """Polylines (N, 2) px along which neighbouring elements do *not* touch in 3D."""
    blank: MultiPolygon = field(default_factory=MultiPolygon)
    """Where the annotator left the image blank on purpose, px."""


@dataclass(frozen=True, repr=False)
class Scene:
    """Everything a solve needs, read-only. Frames are in video order, key frames too."""

    root: Path
    frames: tuple[Frame, ...]
    key_frames: tuple[KeyFrame, ...]
    metric: bool
    """True when world units are metres."""
    warnings: tuple[str, ...] = field(default=())
    """What the readers skipped or repaired, one line each."""
    notes: tuple[str, ...] = field(default=())
    """What else there is to know, and is in order: drawings that are left out because they are meant to be."""
    measurements: tuple[Measurement, ...] = ()
    """What was measured in the room by hand."""
    scale_sigma_share: float | None = None
    """σ of the scale of the cameras' path, as a share of it; None = nobody said."""

    def __repr__(self) -> str:
        elements = sum(len(key_frame.elements) for key_frame in self.key_frames)
        unit = "metric" if self.metric else "without a unit"
        return (
            f"<Scene {self.root}: {len(self.frames)} frames, {len(self.key_frames)} key frames, {elements} elements, "
            f"{unit}>"
        )

    def _repr_html_(self) -> str:
        """In notebooks: what there is, and a row for each key frame."""
        drawn = [(self.frames[one.frame].name, [element.label for element in one.elements]) for one in self.key_frames]
        rows = [(name, *(labels.count(label) or "" for label in LABELS)) for name, labels in drawn]
        return html_table(repr(self).strip("<>"), ("key frame", *LABELS), rows)

    def frame_of(self, key_frame: int) -> Frame:
        """The frame that key frame number ``key_frame`` annotates."""
        return self.frames[self.key_frames[key_frame].frame]

    def require_elements(self) -> None:
        """Raise GtlayoutError when no key frame has an element; a key frame without any among others is fine."""
        if not any(key_frame.elements for key_frame in self.key_frames):
            raise GtlayoutError(
                f"{self.root}: no element is annotated in any frame, so there is nothing to reconstruct: draw the "
                "surfaces of at least one frame"
            )


def scaled(scene: Scene, factor: float) -> Scene:
    """The scene in metres: ``factor`` is how many a unit of it is. Everything but camera positions stays."""
    frames = tuple(
        replace(frame, camera=replace(frame.camera, t_cam_from_world=factor * frame.camera.t_cam_from_world))
        for frame in scene.frames
    )
    return replace(scene, frames=frames, metric=True)


def shrunk(scene: Scene, factor: float) -> Scene:
    """The scene with the images of its key frames smaller by ``factor``, for rendering: cameras and drawings only."""
    if factor == 1.0:
        return scene
    frames = list(scene.frames)
    for key_frame in scene.key_frames:
        frame = frames[key_frame.frame]
        frames[key_frame.frame] = replace(frame, camera=_smaller(frame.camera, factor))
    return replace(
        scene,
        frames=tuple(frames),
        key_frames=tuple(
            replace(
                key_frame,
                elements=tuple(
                    replace(
                        element,
                        amodal=shapely.transform(element.amodal, lambda px: px / factor),
                        visible=shapely.transform(element.visible, lambda px: px / factor),
                    )
                    for element in key_frame.elements
                ),
                occlusion_edges=tuple(line / factor for line in key_frame.occlusion_edges),
            )
            for key_frame in scene.key_frames
        ),
    )


def _smaller(camera: Camera, factor: float) -> Camera:
    width, height = (max(1, round(side / factor)) for side in (camera.width, camera.height))
    return replace(camera, K=np.diag([1 / factor, 1 / factor, 1.0]) @ camera.K, width=width, height=height)
