"""Reprojection IoU: the layout, rendered into key frames, against what is drawn there (paper 3.5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gtlayout.geometry.raster import LabelImage, annotated_labels
from gtlayout.instances import Instance
from gtlayout.quality.measures import ElementIoU
from gtlayout.scene import Camera, IntArray, Scene


def element_ious(
    scene: Scene,
    instances: Sequence[Instance],
    seen_by: Callable[[Camera], LabelImage],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[ElementIoU, ...]:
    """Every annotated element against a rendering: ``seen_by`` gives (H, W) instances, -1 where there is nothing.

    ``progress`` is called with (key frames done, key frames in all).
    """
    elements = []
    progress(0, len(scene.key_frames))
    for k in range(len(scene.key_frames)):
        rendered = seen_by(scene.frame_of(k).camera)
        overlap = _overlap(rendered, annotated_labels(scene, instances, k), len(instances))
        for i, instance in enumerate(instances):
            own = [i, *(j for j, other in enumerate(instances) if other.host == i)]
            for frame, element in instance.members:
                if frame == k:
                    elements.append(ElementIoU(k, element, i, _iou(overlap, own)))
        progress(k + 1, len(scene.key_frames))
    return tuple(elements)


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
