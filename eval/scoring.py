"""The columns of the paper's Table 1: what is measured in one scene, and what that makes over many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtlayout.evaluation import Evaluation
from metrics import Metric, mean_over

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
        Metric("depth_error", depth.mean if depth else np.nan, "m", False),
        Metric("depth_error_trimmed", depth.trimmed_mean if depth else np.nan, "m", False),
        Metric("depth_error_median", depth.median if depth else np.nan, "m", False),
        *(
            Metric(key, np.nan if share is None else share, "", True)
            for key, share in (
                ("within_5cm", depth.within_5cm if depth else None),
                ("within_10cm", depth.within_10cm if depth else None),
            )
        ),
        Metric("normal_error", normal_deg, "°", False),
        Metric("offset_error", offset, "m", False),
        Metric("precision", evaluation.precision, "", True),
        Metric("recall", evaluation.recall, "", True),
        Metric("right_instance", evaluation.elements_on_right_instance / named if named else np.nan, "", True),
        Metric("time", seconds, "s", False),
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
