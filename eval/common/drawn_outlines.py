"""Outlines that a person drew, and which of the proposed ones belong to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment
from shapely import MultiPolygon

from gtlayout.proposals.outlines import segments
from gtlayout.proposals.snapping import on_border
from gtlayout.scene import Camera, Element, FloatArray

SAMPLES = 21
"""Points of an edge whose distance from an outline is measured."""
BORDER_PX = 3.0
"""Edges that lie this near to the border of the image throughout are not counted: they are right by themselves."""
MATCHED_IOU = 0.1
"""What is proposed and overlaps with nothing drawn by more is false."""


def inner_edges(region: MultiPolygon, camera: Camera) -> list[FloatArray]:
    """(2, 2) px the edges that do not lie on the border of the image."""
    within = BORDER_PX * camera.annotation_scale
    return [edge for edge in segments(region) if not on_border(edge, camera, within)]


def distances_px(edge: FloatArray, outline: MultiPolygon) -> FloatArray:
    """(N,) px of points all along an edge (2, 2), its ends included, from an outline; infinite from none."""
    if outline.is_empty:
        return np.full(SAMPLES, np.inf)
    points = edge[0] + np.linspace(0, 1, SAMPLES)[:, None] * (edge[1] - edge[0])
    distances: FloatArray = shapely.distance(outline.boundary, shapely.points(points))
    return distances


def matched_elements(
    proposed: Sequence[Element], wanted: Sequence[Element], *, same_label: bool
) -> tuple[FloatArray, dict[int, int]]:
    """(W, P) IoUs, and for each wanted element the proposed one that is meant, by the Hungarian method.

    With ``same_label`` elements of different labels have nothing in common.
    """
    iou = np.array([[_iou(a, b) if a.label == b.label or not same_label else 0.0 for b in proposed] for a in wanted])
    iou = iou.reshape(len(wanted), len(proposed))
    pairs = zip(*(index.tolist() for index in linear_sum_assignment(-iou)), strict=True)
    return iou, {w: p for w, p in pairs if iou[w, p] > MATCHED_IOU}


def _iou(a: Element, b: Element) -> float:
    both = a.amodal.intersection(b.amodal).area
    return float(both / max(a.amodal.area + b.amodal.area - both, 1e-9))
