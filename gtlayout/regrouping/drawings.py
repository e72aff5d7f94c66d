"""Each key frame against what all others predict in it: elements that are lost, and drawings that cannot be right.

Where the planes are known, so is what a camera must see of them. An element that no other key frame shows may be an
instance that others know well; two elements may have each other's label; and a whole drawing may be of another place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.extents import extents_without
from gtlayout.instances import Instance, Member, Members, Plane
from gtlayout.prediction.matching import Overlap, match, overlap
from gtlayout.prediction.predict import Prediction, predict
from gtlayout.regrouping.config import RegroupingConfig
from gtlayout.scene import FloatArray, IntArray, Label, Scene


@dataclass(frozen=True)
class KeyFrameMatch:
    """The elements of one key frame against what all others predict in it."""

    key_frame: int
    own: IntArray
    """(E,) the instance that each element belongs to."""
    others: IntArray
    """(E,) number of other key frames that show this instance."""
    matched: tuple[int | None, ...]
    """The instance that each element looks like; None when it looks like none."""
    labels: tuple[Label, ...]
    """(I,) of the instances."""
    overlap: Overlap
    prediction: Prediction
    """What all others predict in it."""

    @property
    def own_iou(self) -> FloatArray:
        """(E,) IoU of each element with what is predicted of its own instance."""
        own: FloatArray = self.overlap.iou[np.arange(len(self.own)), self.own]
        return own


@dataclass(frozen=True)
class Swap:
    """Two elements of one key frame that have each other's label."""

    first: Member
    second: Member


@dataclass(frozen=True)
class Rejoin:
    """An element that is not what its instance is, and the instance that it is."""

    member: Member
    instance: int
    iou: float
    """Of its outline with the predicted one."""


def match_key_frames(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    config: RegroupingConfig,
    extent: ExtentConfig,
) -> tuple[KeyFrameMatch, ...]:
    """Predict every key frame from the extents that all others see, and match its elements to that."""
    key_frames = [k for k, key_frame in enumerate(scene.key_frames) if key_frame.elements]
    instance_of = {member: i for i, instance in enumerate(instances) for member in instance.members}
    labels = tuple(instance.label for instance in instances)
    matches = []
    for k, extents in zip(key_frames, extents_without(scene, instances, planes, key_frames, extent), strict=True):
        elements = scene.key_frames[k].elements
        prediction = predict(planes, extents, instances, scene.frame_of(k).camera)
        found = overlap(elements, prediction)
        matched = match(found, [element.label for element in elements], labels, config.prediction)
        own = np.array([instance_of[k, e] for e in range(len(elements))])
        others = np.array([len(instances[i].members) - 1 for i in own])
        matches.append(KeyFrameMatch(k, own, others, tuple(matched), labels, found, prediction))
    return tuple(matches)


def find_swaps(scene: Scene, matches: Sequence[KeyFrameMatch], config: RegroupingConfig) -> tuple[Swap, ...]:
    """The pairs of elements that have each other's label: each alone with its own, and just like one of the other."""
    swaps = []
    for found in matches:
        elements = scene.key_frames[found.key_frame].elements
        alike = [
            (e, i)
            for e, i in _like_another(found, config)
            if found.others[e] == 0
            and found.labels[i] != elements[e].label
            and found.overlap.iou[e, i] >= config.min_swapped_iou
        ]
        swaps += [
            Swap((found.key_frame, e), (found.key_frame, f))
            for number, (e, i) in enumerate(alike)
            for f, j in alike[number + 1 :]
            if found.labels[i] == elements[f].label and found.labels[j] == elements[e].label
        ]
    return tuple(swaps)


def find_rejoins(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    matches: Sequence[KeyFrameMatch],
    config: RegroupingConfig,
) -> tuple[Rejoin, ...]:
    """The elements that look like an instance of the others and not like their own.

    Nothing may speak for where they are: either no other key frame shows the instance and nothing places it, or what
    the others show of it lies elsewhere.
    """
    rejoins = []
    for found in matches:
        elements = scene.key_frames[found.key_frame].elements
        for e, i in _like_another(found, config):
            unplaced = found.others[e] == 0 and not planes[found.own[e]].observable
            astray = found.others[e] > 0 and found.own_iou[e] < config.min_rejoin_iou
            if (
                (unplaced or astray)
                and found.overlap.iou[e, i] >= config.min_rejoin_iou
                and instances[i].label == elements[e].label
                and found.key_frame not in {k for k, _ in instances[i].members}
            ):
                rejoins.append(Rejoin((found.key_frame, e), i, float(found.overlap.iou[e, i])))
    return tuple(rejoins)


def find_contradictions(
    scene: Scene, matches: Sequence[KeyFrameMatch], config: RegroupingConfig
) -> tuple[Members, ...]:
    """The elements drawn where all others see something else, by key frame.

    All elements of a key frame are among them when those that contradict make up most of what is drawn in it. Other key
    frames must agree on the instance: where none do, its plane is what is wrong. An element that looks like another
    instance of its label is drawn right and in the wrong instance, which splits and joins mend.
    """
    agreeing = np.bincount(
        np.concatenate([found.own[found.own_iou >= config.prediction.min_iou] for found in matches]),
        minlength=len(matches[0].labels),
    )
    found_in = []
    for found in matches:
        elements = scene.key_frames[found.key_frame].elements
        area = np.array([element.amodal.area for element in elements])
        known = found.overlap.known_share >= config.min_known_share
        astray = [i is not None and found.labels[i] == of.label for of, i in zip(elements, found.matched, strict=True)]
        against = known & (found.own_iou < config.max_contradicted_iou) & ~np.array(astray)
        certain = against & (agreeing[found.own] >= config.min_others)
        whole = certain.any() and area[against].sum() > config.max_contradicted_share * area.sum()
        alone = certain & (found.own_iou < config.max_alone_iou)
        chosen = range(len(area)) if whole else np.nonzero(alone)[0].tolist()
        if chosen:
            found_in.append(tuple((found.key_frame, e) for e in chosen))
    return tuple(found_in)


def _like_another(found: KeyFrameMatch, config: RegroupingConfig) -> Iterator[tuple[int, int]]:
    """Elements that look like an instance that is not their own, each with that."""
    for e, i in enumerate(found.matched):
        if i is None or i == found.own[e]:
            continue
        # Neither a corner of the element that others know, nor a patch on a wall that is not drawn here.
        if min(found.overlap.known_share[e], found.overlap.drawn_share[i]) >= config.min_known_share:
            yield e, i
