"""How good a layout is: against the annotations, the depth maps and the true planes of its scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.instance_scores import (
    PlaneError,
    found_in_annotations,
    found_in_truth,
    match_instances,
    plane_error,
)
from gtlayout.geometry.raster import fill, rings_of
from gtlayout.geometry.render import render
from gtlayout.io.pixels.images import read_depth
from gtlayout.io.truth import read_truth
from gtlayout.layout import Layout
from gtlayout.quality.assess import assess
from gtlayout.quality.config import QualityConfig
from gtlayout.quality.headline import Headline
from gtlayout.quality.measures import Prediction
from gtlayout.scene import FloatArray, Scene

WORST_SHARE = 0.01
"""Real depth maps hold up to 1 % gross outliers."""
CLOSE_M, NEAR_M = 0.05, 0.1
"""Errors that a user of a floor plan accepts, and errors up to which walls can still be told apart."""


@dataclass(frozen=True)
class DepthError:
    """Absolute error of the rendered depth on the elements' visible parts where depth was measured; world unit."""

    mean: float
    """The paper's ε."""
    trimmed_mean: float
    """Without the worst 1 % of pixels."""
    median: float
    within_5cm: float | None
    """Share of all such pixels, including those without an instance; None where the unit is not the metre."""
    within_10cm: float | None
    pixels: int
    missing: int
    """Number of such pixels at which the layout shows no instance; they are in none of the three errors above."""
    by_instance: tuple[tuple[str, float, int], ...]
    """(name, mean error, pixels) of each instance whose visible parts have depth."""


@dataclass(frozen=True)
class Evaluation:
    """All figures; None where the scene lacks what they need."""

    metric: bool
    headline: Headline
    """What to do with the scene, in a word, and why."""
    iou: float
    accepted: bool
    sigma_depth_share: float
    """σ of depth as a share of the depth, as in ``Quality``."""
    predicted: Prediction
    """The verdict of the covariances alone, as in ``Quality``."""
    openings_iou: float | None
    instances: int
    unobservable: tuple[str, ...]
    depth: DepthError | None
    planes: tuple[PlaneError, ...]
    """One per true plane that has a normal and was fitted to depth; empty without gt_planes.json."""
    missing_planes: tuple[str, ...]
    """True planes no instance stands for."""
    elements: int
    """Number of elements for which the truth names a plane."""
    elements_on_right_instance: int
    precision: float
    """Share of the instances that are right: normal within 9°, IoU of the extent with the true one at least 0.9, or of
    the rendering with the annotations where no truth is known."""
    recall: float
    """Share of the true planes for which there is a right instance; without truth, share of the elements."""
    wrong: tuple[str, ...]
    """Instances that are not right."""


def evaluate(scene: Scene, layout: Layout, config: QualityConfig | None = None) -> Evaluation:
    """Compare ``layout`` with its scene's annotations, ``depth/`` and ``gt_planes.json``, as far as there are any.

    Raises:
        GtlayoutError: a depth map or the truth cannot be read, or the layout belongs to other annotations.
    """
    _check_members(scene, layout)
    quality = assess(scene, layout.instances, layout.planes, layout.extents, config or QualityConfig())
    truth = read_truth(scene)
    if truth is not None:
        truth = truth.scaled(_unit_of_truth_m(layout))
    match = match_instances(layout, truth) if truth else {}
    planes = tuple(
        plane_error(layout, match[name], name, plane)
        for name, plane in (truth.planes.items() if truth else ())
        if plane.scored and name in match and layout.planes[match[name]].observable
    )
    found = {error.truth for error in planes}
    named = [
        (name, match.get(name) == i)
        for i, instance in enumerate(layout.instances)
        for member in instance.members
        if truth and (name := truth.elements.get(member)) is not None
    ]
    hits = found_in_truth(layout, quality, truth, match) if truth else found_in_annotations(layout, quality)
    return Evaluation(
        metric=scene.metric,
        headline=quality.headline,
        iou=quality.iou,
        accepted=quality.accepted,
        sigma_depth_share=quality.sigma_depth_share,
        predicted=quality.predicted,
        openings_iou=quality.openings_iou,
        instances=len(layout.instances),
        unobservable=tuple(
            instance.name
            for instance, plane in zip(layout.instances, layout.planes, strict=True)
            if not plane.observable
        ),
        depth=depth_error(scene, layout),
        planes=planes,
        missing_planes=tuple(n for n, p in (truth.planes.items() if truth else ()) if p.scored and n not in found),
        elements=len(named),
        elements_on_right_instance=sum(right for _, right in named),
        precision=hits.precision,
        recall=hits.recall,
        wrong=tuple(instance.name for instance in layout.instances if instance.name not in hits.right),
    )


def _check_members(scene: Scene, layout: Layout) -> None:
    annotated = [(k, e) for k, key_frame in enumerate(scene.key_frames) for e in range(len(key_frame.elements))]
    if sorted(member for instance in layout.instances for member in instance.members) != annotated:
        raise GtlayoutError(f"{scene.root}: the layout was made from other annotations; solve the scene again")


def _unit_of_truth_m(layout: Layout) -> float:
    """Units of the layout in a unit of the scene's depth maps and true planes."""
    return layout.scale.factor if layout.scale is not None and layout.scale.gave_unit else 1.0


def depth_error(scene: Scene, layout: Layout) -> DepthError | None:
    """Over all pixels of visible parts with measured depth, compared with the depth of the rendered layout there; None
    without any. Raises GtlayoutError when a depth map cannot be read.
    """
    errors: list[FloatArray] = []
    owners: list[int] = []
    missing = 0
    for k, key_frame in enumerate(scene.key_frames):
        frame = scene.frame_of(k)
        if frame.depth_path is None:
            continue
        measured = _unit_of_truth_m(layout) * read_depth(frame)
        _, rendered = render(layout.planes, layout.extents, layout.instances, frame.camera)
        instance_of = {e: i for i, instance in enumerate(layout.instances) for j, e in instance.members if j == k}
        for e, element in enumerate(key_frame.elements):
            seen = np.isfinite(measured) & fill(rings_of(element.visible), *measured.shape)
            missing += int(np.count_nonzero(seen & ~np.isfinite(rendered)))
            seen &= np.isfinite(rendered)
            if seen.any():
                errors.append(np.abs(rendered[seen] - measured[seen]))
                owners.append(instance_of[e])
    if not errors:
        return None
    pooled = np.sort(np.concatenate(errors))
    by_instance = []
    for i in sorted(set(owners)):
        own = np.concatenate([error for error, owner in zip(errors, owners, strict=True) if owner == i])
        by_instance.append((layout.instances[i].name, float(own.mean()), len(own)))
    kept = max(1, int(np.ceil((1 - WORST_SHARE) * len(pooled))))
    close, near = (
        float(np.searchsorted(pooled, limit_m, side="right") / (len(pooled) + missing)) if scene.metric else None
        for limit_m in (CLOSE_M, NEAR_M)
    )
    return DepthError(
        mean=float(pooled.mean()),
        trimmed_mean=float(pooled[:kept].mean()),
        median=float(np.median(pooled)),
        within_5cm=close,
        within_10cm=near,
        pixels=len(pooled),
        missing=missing,
        by_instance=tuple(by_instance),
    )
