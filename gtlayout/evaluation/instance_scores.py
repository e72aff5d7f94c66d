"""Which instances are right: against true planes, or against the elements where no truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gtlayout.instances import Extent, Plane, PlaneFrame
from gtlayout.io.truth import TruePlane, Truth
from gtlayout.layout import Layout
from gtlayout.quality.assess import Quality
from gtlayout.scene import FloatArray

MAX_NORMAL_DEG = 9.0
MIN_EXTENT_IOU = 0.9
"""An instance is right when its normal is right within 10 % of a right angle and its extent within 10 %. The paper's
inspectors judged this by eye."""


@dataclass(frozen=True)
class PlaneError:
    """A true plane and the instance that stands for it."""

    truth: str
    instance: str
    normal_deg: float
    offset: float
    """Distance of the true plane from the centroid of the instance's extent, world unit."""
    sigma_normal_deg: float
    """The predicted σ of ``normal_deg``."""
    sigma_offset: float
    """The predicted σ of ``offset``."""


@dataclass(frozen=True)
class Found:
    """Share of the instances that are right, and share of the truth that is found."""

    precision: float
    recall: float
    right: tuple[str, ...]
    """Names of the instances that are right."""


def match_instances(layout: Layout, truth: Truth) -> dict[str, int]:
    """The instance that stands for each true plane: the one-to-one matching that puts most elements right."""
    names = list(truth.planes)
    votes = np.zeros((len(names), len(layout.instances)))
    for i, instance in enumerate(layout.instances):
        for member in instance.members:
            if (name := truth.elements.get(member)) is not None:
                votes[names.index(name), i] += 1
    rows, columns = linear_sum_assignment(-votes)
    return {names[r]: int(c) for r, c in zip(rows, columns, strict=True) if votes[r, c] > 0}


def plane_error(layout: Layout, index: int, name: str, true: TruePlane) -> PlaneError:
    """The errors of instance number ``index`` against the true plane ``name``, with their predicted σ."""
    plane = layout.planes[index]
    centroid = centroid_world(layout.extents[index])
    return PlaneError(
        truth=name,
        instance=layout.instances[index].name,
        normal_deg=_angle_deg(plane, true),
        offset=abs(float(true.normal @ centroid) + true.d),
        sigma_normal_deg=plane.sigma_normal_deg,
        sigma_offset=float(plane.sigma_offset(centroid)),
    )


def centroid_world(extent: Extent) -> FloatArray:
    """(3,) centroid of an extent; its frame's origin when it is empty."""
    point = extent.region.centroid
    uv = np.zeros((1, 2)) if point.is_empty else np.array([[point.x, point.y]])
    centroid: FloatArray = extent.frame.to_world(uv)[0]
    return centroid


def found_in_truth(layout: Layout, quality: Quality, truth: Truth, match: Mapping[str, int]) -> Found:
    """Precision over instances, recall over the true planes that the annotations show.

    Where the normal of a true plane is not known, only its extent is compared. Where its extent is not known, the IoU
    with the elements is used instead.
    """
    shown = set(truth.elements.values())
    right = [name for name, i in match.items() if name in shown and _is_right(layout, quality, i, truth.planes[name])]
    return Found(
        precision=len(right) / len(layout.instances),
        recall=len(right) / len(shown) if shown else np.nan,
        right=tuple(layout.instances[match[name]].name for name in right),
    )


def found_in_annotations(layout: Layout, quality: Quality) -> Found:
    """Precision over instances by their mean IoU, recall over all elements by theirs."""
    right = [
        instance.name
        for instance, judged in zip(layout.instances, quality.instances, strict=True)
        if judged.iou >= MIN_EXTENT_IOU
    ]
    return Found(
        precision=len(right) / len(layout.instances),
        recall=float(np.mean([element.iou >= MIN_EXTENT_IOU for element in quality.elements])),
        right=tuple(right),
    )


def extent_iou(extent: Extent, true: TruePlane) -> float:
    """IoU of an extent with a true one, the first projected orthogonally on the plane of the second."""
    assert true.extent_world is not None
    frame = PlaneFrame.across(true.normal, -true.d * true.normal)
    # Projected at an angle a polygon may touch itself.
    found = frame.region(extent.frame.rings_to_world(extent.region)).buffer(0)
    wanted = frame.region(true.extent_world).buffer(0)
    union = found.union(wanted).area
    return float(found.intersection(wanted).area / union) if union else 0.0


def _is_right(layout: Layout, quality: Quality, index: int, true: TruePlane) -> bool:
    plane = layout.planes[index]
    if not plane.observable or (true.scored and _angle_deg(plane, true) > MAX_NORMAL_DEG):
        return False
    known = true.extent_world is not None
    iou = extent_iou(layout.extents[index], true) if known else quality.instances[index].iou
    return iou >= MIN_EXTENT_IOU


def _angle_deg(plane: Plane, true: TruePlane) -> float:
    return float(np.rad2deg(np.arccos(np.clip(plane.normal @ true.normal, -1.0, 1.0))))
