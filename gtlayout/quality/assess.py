"""Stage 7: reprojection IoU by rendering, uncertainty, and a verdict (paper 3.5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from gtlayout.figures import short
from gtlayout.geometry.depth import depth_at_centroid
from gtlayout.geometry.render import render
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import Extent, Instance, Plane
from gtlayout.quality.causes import causes
from gtlayout.quality.config import QualityConfig
from gtlayout.quality.depth import drawn_pixels
from gtlayout.quality.headline import Headline, headline
from gtlayout.quality.measures import InstanceQuality, Measures
from gtlayout.quality.reprojection import element_ious, mean_by_frame
from gtlayout.quality.unit import unit_doubt
from gtlayout.scene import Scene


@dataclass(frozen=True)
class Quality(Measures):
    """The verdict on a layout: a headline, and the measures it is made of."""

    headline: Headline
    """What to do with the scene, in a word, and why."""


def assess(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    extents: Sequence[Extent],
    config: QualityConfig,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Quality:
    """Render the layout into every key frame and compare it with the annotation.

    ``progress`` is called with (key frames done, key frames in all).

    Raises ``GtlayoutError`` when no key frame has an element.
    """
    scene.require_elements()
    elements = element_ious(scene, instances, lambda camera: render(planes, extents, instances, camera)[0], progress)
    hosted = [instance.host is not None for instance in instances]
    frame_ious = mean_by_frame(scene, instances, elements)
    iou = float(np.nanmean(frame_ious))
    in_walls = [e.iou for e in elements if hosted[e.instance]]
    strips = {i: strip for i, extent in enumerate(extents) if (strip := strip_of(extent))}
    drawn = drawn_pixels(scene, instances, planes, strips)
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
    doubt = unit_doubt(scene, instances, planes, drawn.distance[known], config)
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
    return Quality(**vars(measures), headline=headline(scene, instances, extents, measures, config, doubt))


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
    strip = strip_of(extent)
    sigma_depth, depth = depth_at_centroid(scene, instance, plane, strip)
    sigma_normal_deg = plane.sigma_normal_deg if strip is None else strip.cylinder.sigma_normal_deg
    wrong = [f"IoU below {config.accept_iou:g}"] if iou < config.accept_iou else []
    uncertain = []
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
