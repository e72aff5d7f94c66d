"""Which element of a key frame shows which instance, by overlap with what is predicted there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment

from gtlayout.prediction.config import PredictionConfig
from gtlayout.prediction.predict import Prediction
from gtlayout.scene import OPENINGS, Element, FloatArray, Label

_DECIMALS = 9
"""Of an IoU: the decision between equals does not depend on the last bit."""


@dataclass(frozen=True)
class Overlap:
    """E drawn elements against I predicted instances."""

    iou: FloatArray
    """(E, I) IoU of drawn and predicted region, counted where something is both drawn and predicted: others may not
    have seen all that is drawn here, and what hides a surface here need not be drawn."""
    known_share: FloatArray
    """(E,) share of the drawn region on which any instance is predicted."""
    drawn_share: FloatArray
    """(I,) share of the region predicted of an instance on which any element is drawn; 0 where none is predicted."""


def overlap(elements: Sequence[Element], prediction: Prediction) -> Overlap:
    """Compare the elements of a key frame with what is predicted there. Openings are drawn on top of their walls."""
    openings = shapely.union_all([element.amodal for element in elements if element.label in OPENINGS])
    drawn = [
        element.amodal if element.label in OPENINGS else element.amodal.difference(openings) for element in elements
    ]
    both = shapely.area(
        shapely.intersection(np.array(drawn, dtype=object)[:, None], np.array(prediction.visible, dtype=object)[None])
    )
    by_element, by_instance = both.sum(axis=1), both.sum(axis=0)
    union = by_element[:, None] + by_instance[None] - both
    area, visible = shapely.area(drawn), shapely.area(prediction.visible)
    return Overlap(
        iou=np.divide(both, union, out=np.zeros_like(both), where=union > 0).round(_DECIMALS),
        known_share=np.divide(by_element, area, out=np.zeros_like(area), where=area > 0),
        drawn_share=np.divide(by_instance, visible, out=np.zeros_like(visible), where=visible > 0),
    )


def match(
    found: Overlap, drawn: Sequence[Label], predicted: Sequence[Label], config: PredictionConfig
) -> list[int | None]:
    """The instance that each of E elements shows, by the Hungarian method on the IoU; None where none fits.

    Equal labels are preferred, but another label does not exclude a match, so that labels that are exchanged show.

    Args:
        found: Of the elements, labelled ``drawn``, and the instances, labelled ``predicted``.
    """
    other = np.array([[a != b for b in predicted] for a in drawn]).reshape(found.iou.shape)
    score = np.where(found.iou >= config.min_iou, found.iou - config.other_label_price * other, 0.0)
    matched: list[int | None] = [None] * len(drawn)
    for e, i in zip(*linear_sum_assignment(-score), strict=True):
        if score[e, i] > 0:
            matched[e] = int(i)
    return matched
