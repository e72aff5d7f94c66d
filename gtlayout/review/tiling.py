"""Gaps and overlaps: the elements of a key frame cover its image, each pixel once. Nothing needs to be solved."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
import shapely

from gtlayout.review.config import ReviewConfig
from gtlayout.review.findings import Finding, image_area, named, opened, outline
from gtlayout.scene import OPENINGS, SAME_BORDER_PX, Scene


def tiling_findings(scene: Scene, config: ReviewConfig | None = None) -> tuple[Finding, ...]:
    """All gaps and overlaps, key frame by key frame. Doors and windows lie on their walls, but not on each other."""
    config = config or ReviewConfig()
    return tuple(
        finding
        for k in range(len(scene.key_frames))
        for finding in (*_gaps(scene, k, config), *_overlaps(scene, k, config))
    )


def _gaps(scene: Scene, k: int, config: ReviewConfig) -> Iterator[Finding]:
    key_frame, camera = scene.key_frames[k], scene.frame_of(k).camera
    scale = camera.annotation_scale
    regions = np.array([element.amodal for element in key_frame.elements], dtype=object)
    drawn = shapely.union_all([*regions, key_frame.blank])
    image = shapely.box(0, 0, camera.width, camera.height)
    for gap in opened(image.difference(drawn), config.opening_px * scale).geoms:
        if gap.area <= config.min_area_px2 * scale**2:
            continue
        # A gap is closed by the elements that it lies between.
        border = shapely.length(shapely.intersection(shapely.boundary(regions), gap.buffer(SAME_BORDER_PX * scale)))
        beside = [i for i in np.argsort(-border.round(6), kind="stable")[:2] if border[i] > 0]
        between = " and ".join(named(key_frame.elements[i]) for i in beside)
        share = gap.area / image_area(scene, k)
        yield Finding(
            k,
            scene.frame_of(k).name,
            key_frame.elements[beside[0]].id if beside else None,
            None,
            "gap",
            f"gap of {share:.1%} of the image{f' beside {between}' if between else ''}: draw what is there, or mark it "
            "as blank",
            share,
            outline(gap),
        )


def _overlaps(scene: Scene, k: int, config: ReviewConfig) -> Iterator[Finding]:
    scale = scene.frame_of(k).camera.annotation_scale
    for a, b in combinations(scene.key_frames[k].elements, 2):
        if not shapely.intersects(a.amodal, b.amodal):
            continue
        both = opened(a.amodal.intersection(b.amodal), config.opening_px * scale)
        twice = both.area > config.same_iou * (a.amodal.area + b.amodal.area - both.area)
        on_its_wall = a.label != b.label and not OPENINGS.isdisjoint({a.label, b.label})
        if not twice and (on_its_wall or both.area <= config.min_area_px2 * scale**2):
            continue
        smaller = a if a.amodal.area <= b.amodal.area else b
        share = both.area / smaller.amodal.area
        what = "are almost the same polygon: delete one"
        if not twice:
            what = f"overlap by {share:.0%} of the smaller: one label wrong, or one drawn too large"
        yield Finding(
            k,
            scene.frame_of(k).name,
            smaller.id,
            None,
            "overlap",
            f"{named(a)} and {named(b)} {what}",
            share,
            outline(both),
        )
