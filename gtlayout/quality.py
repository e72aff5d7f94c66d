"""Stage 7: reprojection IoU by rendering, uncertainty, and a verdict (paper 3.5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely

from gtlayout.causes import causes
from gtlayout.config import QualityConfig
from gtlayout.figures import short
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.raster import LabelImage, annotated_labels
from gtlayout.geometry.render import render
from gtlayout.headline import Headline, headline
from gtlayout.instances import Extent, Instance, Plane
from gtlayout.scene import Camera, FloatArray, IntArray, Scene

Verdict = Literal["ok", "weak", "unobservable"]
Prediction = Literal["trustworthy", "doubtful"]

_STEP_PX = 4
"""Grid on which σ of depth is sampled: planes have no detail."""


@dataclass(frozen=True)
class ElementIoU:
    """One annotated element, with the doors and windows in it, against the rendering of its instance."""

    key_frame: int
    element: int
    instance: int
    iou: float


@dataclass(frozen=True)
class InstanceQuality:
    """What one instance is worth."""

    iou: float
    """Mean over the key frames that show it."""
    sigma_normal_deg: float
    sigma_depth: float
    """σ of its depth at the centroid of its largest annotated polygon, world unit."""
    depth: float
    """That depth, world unit."""
    verdict: Verdict
    reason: str
    """Why it is not ok; empty when it is."""
    causes: tuple[str, ...] = ()
    """What makes it uncertain, the most important first; empty when it is certain enough or the cause is not known."""
    drawn_share: float = 0.0
    """Share of all drawn pixels that lie on it."""
    reach: float = np.nan
    """How far its extent reaches from the nearest camera that it was drawn in, as a multiple of the room's size; NaN
    without extent, or when nothing is known. The room is as large as 95 % of the known pixels are near."""


@dataclass(frozen=True)
class Measures:
    """What is measured of a layout: against the drawings, and by its covariances."""

    iou: float
    """Mean over the key frames of the mean over their structural elements. Doors and windows count as part of the wall
    they lie in, as in the CAD-Estate release, which stores them so; ``openings_iou`` judges them alone.
    """
    accepted: bool
    """What the IoU says."""
    sigma_depth_share: float
    """Predicted σ of depth as a share of the depth: mean over all drawn pixels, 1 where nothing is known."""
    predicted: Prediction
    """What the marginals alone say."""
    known_share: float
    """Share of the drawn pixels whose depth is known."""
    openings_iou: float | None
    """Mean IoU of the doors and windows that have a host; None when there are none."""
    frames: tuple[float, ...]
    """Mean IoU of each key frame; NaN for one that shows nothing but doors and windows."""
    elements: tuple[ElementIoU, ...]
    """Every annotated element."""
    instances: tuple[InstanceQuality, ...]
    """One per instance."""
    worst_frame: int
    """Index of the key frame with the lowest IoU."""
    worst_element: int
    """Index into ``elements`` of the lowest IoU: the one to redraw first."""


@dataclass(frozen=True)
class Quality(Measures):
    """The verdict on a layout: a headline, and the measures it is made of."""

    headline: Headline
    """What to do with the scene, in a word, and why."""


@dataclass(frozen=True)
class _Drawn:
    """Pixels of all key frames that something is drawn on, on a grid."""

    instance: IntArray
    """(N,) that lies on top."""
    distance: FloatArray
    """(N,) from the camera to its plane, world unit; NaN where the plane is not seen."""
    sigma_share: FloatArray
    """(N,) σ of depth as a share of it, at most 1; 1 also where a plane is unobservable or not seen."""


def assess(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    extents: Sequence[Extent],
    config: QualityConfig,
) -> Quality:
    """Render the layout into every key frame and compare it with the annotation."""
    elements = element_ious(scene, instances, lambda camera: render(planes, extents, instances, camera)[0])
    hosted = [instance.host is not None for instance in instances]
    frame_ious = mean_by_frame(scene, instances, elements)
    iou = float(np.nanmean(frame_ious))
    in_walls = [e.iou for e in elements if hosted[e.instance]]
    drawn = _drawn_pixels(scene, instances, planes)
    share = float(drawn.sigma_share.mean()) if len(drawn.instance) else 1.0
    known = drawn.sigma_share <= config.known_sigma_depth_share
    room = float(np.quantile(drawn.distance[known], config.room_quantile)) if known.any() else np.nan
    judged = []
    for i, (instance, plane, extent) in enumerate(zip(instances, planes, extents, strict=True)):
        one = _judge(
            scene,
            instance,
            plane,
            extent,
            float(np.mean([e.iou for e in elements if e.instance == i])),
            _reach(scene, instance, extent) / room,
            config,
        )
        judged.append(replace(one, drawn_share=float(np.mean(drawn.instance == i)) if len(drawn.instance) else 0.0))
    measures = Measures(
        iou=iou,
        accepted=iou >= config.accept_iou,
        sigma_depth_share=share,
        predicted="trustworthy" if share <= config.trusted_sigma_depth_share else "doubtful",
        known_share=float(known.mean()) if len(known) else 0.0,
        openings_iou=float(np.mean(in_walls)) if in_walls else None,
        frames=frame_ious,
        elements=elements,
        instances=tuple(judged),
        worst_frame=int(np.nanargmin(frame_ious)),
        worst_element=int(np.argmin([e.iou for e in elements])),
    )
    return Quality(**vars(measures), headline=headline(scene, instances, extents, measures, config))


def element_ious(
    scene: Scene, instances: Sequence[Instance], seen_by: Callable[[Camera], LabelImage]
) -> tuple[ElementIoU, ...]:
    """Every annotated element against a rendering: ``seen_by`` gives (H, W) instances, -1 where there is nothing."""
    elements = []
    for k in range(len(scene.key_frames)):
        rendered = seen_by(scene.frame_of(k).camera)
        overlap = _overlap(rendered, annotated_labels(scene, instances, k), len(instances))
        for i, instance in enumerate(instances):
            own = [i, *(j for j, other in enumerate(instances) if other.host == i)]
            for frame, element in instance.members:
                if frame == k:
                    elements.append(ElementIoU(k, element, i, _iou(overlap, own)))
    return tuple(elements)


def _drawn_pixels(scene: Scene, instances: Sequence[Instance], planes: Sequence[Plane]) -> _Drawn:
    owners, distances, shares = [np.empty(0, dtype=np.int64)], [np.empty(0)], [np.empty(0)]
    for k in range(len(scene.key_frames)):
        camera = scene.frame_of(k).camera
        labels = annotated_labels(scene, instances, k)[::_STEP_PX, ::_STEP_PX]
        for i in np.unique(labels[labels >= 0]):
            y, x = np.nonzero(labels == i)
            points_px = np.column_stack([x, y]).astype(np.float64) * _STEP_PX + 0.5
            sigma, depth = _sigma_depth(planes[i], camera, points_px)
            known = planes[i].observable & (sigma < depth)
            owners.append(np.full(len(x), i))
            distances.append(depth * np.linalg.norm(camera.rays_world(points_px), axis=1))
            shares.append(np.where(known, sigma / depth, 1.0))
    return _Drawn(np.concatenate(owners), np.concatenate(distances), np.concatenate(shares))


def mean_by_frame(scene: Scene, instances: Sequence[Instance], elements: Sequence[ElementIoU]) -> tuple[float, ...]:
    """Mean IoU of the structural elements in each key frame; NaN for one that shows nothing but doors and windows."""
    hosted = [instance.host is not None for instance in instances]
    frames = [
        [e.iou for e in elements if e.key_frame == k and not hosted[e.instance]] for k in range(len(scene.key_frames))
    ]
    return tuple(float(np.mean(ious)) if ious else np.nan for ious in frames)


def _overlap(rendered: LabelImage, annotated: LabelImage, count: int) -> IntArray:
    """(count + 1, count + 1) pixels by rendered and annotated instance; the last row and column are "nothing"."""
    size = count + 1
    pairs = (rendered.astype(np.int64) % size) * size + annotated % size
    return np.bincount(pairs.ravel(), minlength=size * size).reshape(size, size)


def _iou(overlap: IntArray, own: Sequence[int]) -> float:
    """IoU of a set of instances, taken as one."""
    both = overlap[np.ix_(own, own)].sum()
    union = overlap[own].sum() + overlap[:, own].sum() - both
    return float(both / union) if union else 0.0


def _reach(scene: Scene, instance: Instance, extent: Extent) -> float:
    """How far an extent reaches from the nearest camera that it was drawn in, world unit; NaN without extent."""
    if extent.region.is_empty or not instance.members:
        return np.nan
    corners = extent.frame.to_world(shapely.get_coordinates(extent.region))
    centers = np.array([scene.frame_of(k).camera.center_world for k, _ in instance.members])
    return float(np.linalg.norm(corners[:, None] - centers, axis=2).min(axis=1).max())


def _judge(
    scene: Scene,
    instance: Instance,
    plane: Plane,
    extent: Extent,
    iou: float,
    reach: float,
    config: QualityConfig,
) -> InstanceQuality:
    if not plane.observable:
        why = causes(instance, plane, config)
        return InstanceQuality(iou, np.nan, np.nan, np.nan, "unobservable", plane.note, why)
    sigma_depth, depth = depth_at_centroid(scene, instance, plane)
    sigma_normal_deg = plane.sigma_normal_deg
    wrong = [f"IoU below {config.accept_iou:g}"] if iou < config.accept_iou else []
    uncertain = [plane.note] if plane.note else []
    if sigma_normal_deg > config.max_sigma_normal_deg:
        uncertain.append(f"normal uncertain by more than {config.max_sigma_normal_deg:g}°")
    if not sigma_depth <= config.max_sigma_depth_share * depth:
        uncertain.append(f"depth uncertain by more than {100 * config.max_sigma_depth_share:g} %")
    if extent.unknown_area > 0:
        left, drawn = extent.region.area, extent.region.area + extent.unknown_area
        unit = "m²" if scene.metric else "u²"
        uncertain.append(f"its extent ends where its depth is unknown: {short(left)} of {short(drawn)} {unit} left")
    if reach > config.max_reach:
        wrong.append(f"its extent is out of all proportion: it reaches {reach:.1f} times as far as the room")
    return InstanceQuality(
        iou,
        sigma_normal_deg,
        sigma_depth,
        depth,
        "weak" if wrong or uncertain else "ok",
        "; ".join(wrong + uncertain),
        causes(instance, plane, config) if uncertain else (),
        reach=reach,
    )


def centroid_of_largest(scene: Scene, instance: Instance) -> tuple[Camera, FloatArray]:
    """The camera that the largest annotated polygon of an instance was drawn in, and its centroid there, (1, 2) px."""
    k, element = max(instance.members, key=lambda member: scene.key_frames[member[0]].elements[member[1]].amodal.area)
    centroid = scene.key_frames[k].elements[element].amodal.centroid
    return scene.frame_of(k).camera, np.array([[centroid.x, centroid.y]])


def depth_at_centroid(scene: Scene, instance: Instance, plane: Plane) -> tuple[float, float]:
    """σ of the depth, and the depth, where the plane is seen through the centroid of the largest annotated polygon."""
    sigma, depth = _sigma_depth(plane, *centroid_of_largest(scene, instance))
    return float(sigma[0]), float(depth[0])


def _sigma_depth(plane: Plane, camera: Camera, points_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) σ of the depth, and the depth, at which a plane is seen at (N, 2) pixels; NaN where it is not."""
    inverse = np.column_stack([points_px, np.ones(len(points_px))]) @ inverse_depth(plane, camera)
    # Zero on the horizon, infinite for a camera on the plane.
    depth = 1 / np.where((inverse > 0) & np.isfinite(inverse), inverse, np.nan)
    rays = camera.rays_world(points_px)
    return plane.sigma_depth(camera.center_world + depth[:, None] * rays, rays), depth
