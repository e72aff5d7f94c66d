"""The columns of the paper's Table 1: what is measured in one scene, and what that makes over many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from common.metrics import Metric, mean_over
from gtlayout.evaluation.evaluate import DepthError, Evaluation

QUALITY_CONTROLLED = ("iou", "depth_error", "depth_error_trimmed", "precision", "recall")
"""Columns that a summary gives over the accepted scenes, too."""


def score(evaluation: Evaluation, seconds: float) -> list[Metric]:
    """One scene. Depth errors of scenes without a unit are left out: their mean would mean nothing."""
    depth = evaluation.depth if evaluation.metric else None
    planes = evaluation.planes
    normal_deg = float(np.median([plane.normal_deg for plane in planes])) if planes else np.nan
    offset = float(np.median([plane.offset for plane in planes])) if planes and evaluation.metric else np.nan
    named = evaluation.elements
    return [
        Metric("accepted", float(evaluation.accepted), "", True),
        Metric("iou", evaluation.iou, "", True),
        *depth_metrics(depth),
        Metric("normal_error", normal_deg, "°", False),
        Metric("offset_error", offset, "m", False),
        Metric("precision", evaluation.precision, "", True),
        Metric("recall", evaluation.recall, "", True),
        Metric("right_instance", evaluation.elements_on_right_instance / named if named else np.nan, "", True),
        Metric("time", seconds, "s", False),
    ]


def depth_metrics(depth: DepthError | None) -> list[Metric]:
    """Depth errors in metres, and the shares of pixels that are near; without values where there is no depth."""
    errors = (np.nan,) * 3 if depth is None else (depth.mean, depth.trimmed_mean, depth.median)
    shares = (None, None) if depth is None else (depth.within_5cm, depth.within_10cm)
    keys = ("depth_error", "depth_error_trimmed", "depth_error_median")
    return [
        *(Metric(key, error, "m", False) for key, error in zip(keys, errors, strict=True)),
        *(
            Metric(key, np.nan if share is None else share, "", True)
            for key, share in zip(("within_5cm", "within_10cm"), shares, strict=True)
        ),
    ]


def refused(seconds: float = np.nan) -> list[Metric]:
    """A scene that gave no layout: not accepted, nothing found, IoU 0, so that giving up never raises a mean."""
    return [
        Metric("accepted", 0.0, "", True),
        Metric("iou", 0.0, "", True),
        Metric("recall", 0.0, "", True),
        Metric("time", seconds, "s", False),
    ]


def summary(scores: Sequence[Sequence[Metric]]) -> list[Metric]:
    """Means over scenes: of all of them ("no quality control" in the paper) and, ``…_accepted``, of the accepted ones.

    Columns without a value in a scene are means over the others.
    """
    accepted = [row for row in scores if any(m.key == "accepted" and m.value == 1.0 for m in row)]
    controlled = {metric.key: metric for metric in mean_over(accepted)}
    columns = [Metric("scenes", float(len(scores)), "", None)]
    # A row with every column comes first where there is one, so that rows that lack some do not shuffle them.
    for metric in mean_over(sorted(scores, key=len, reverse=True)):
        columns.append(metric)
        if metric.key in QUALITY_CONTROLLED:
            value = controlled[metric.key].value if metric.key in controlled else np.nan
            columns.append(Metric(f"{metric.key}_accepted", value, metric.unit, metric.higher_is_better))
    return columns
