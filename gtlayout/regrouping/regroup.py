"""After stage 4: instances that turn out to be one plane are joined, those that turn out to be two are split.

Tracks alone cannot show that a wall that leaves the image is the one that enters it later, and sometimes they join two
walls. The planes and their covariance show both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtlayout.correspondence.matching import form_instances
from gtlayout.extent.config import ExtentConfig
from gtlayout.instances import Instance
from gtlayout.planes.estimate import Estimate
from gtlayout.prepared.measurements import Measurements
from gtlayout.regrouping.config import RegroupingConfig
from gtlayout.regrouping.joins import find_joins
from gtlayout.regrouping.splits import Members, find_splits
from gtlayout.scene import IntArray, Scene


@dataclass(frozen=True)
class Regrouping:
    """New instances, and the reasons for them."""

    instances: tuple[Instance, ...]
    track_instance: IntArray
    """(N,) instance of each track, -1 = none."""
    messages: tuple[str, ...]
    """What was joined and split, one line each."""


def regroup(
    measured: Measurements, solved: Estimate, config: RegroupingConfig, extent: ExtentConfig
) -> Regrouping | None:
    """The instances that follow from the solved planes; None when they do not change.

    An instance that is split is not joined with others until its planes have been solved.
    """
    scene, instances = measured.scene, measured.instances
    splits = find_splits(measured, solved.planes, config, extent)
    halved = {split.instance for split in splits}
    joins = [join for join in find_joins(scene, instances, solved, config, extent) if not halved & set(join.instances)]
    if not splits and not joins:
        return None
    groups: list[Members] = [instance.members for instance in instances]
    messages = []
    for join in joins:
        a, b = join.instances
        pair = _in_words(scene, groups[a][0], groups[b][0])
        messages.append(f"{pair} are one plane (χ² {join.chi2:.1f}): joined")
        groups[a], groups[b] = (*groups[a], *groups[b]), ()
    for split in splits:
        first, second = split.parts
        messages.append(f"{_in_words(scene, first[0], second[0])} are two planes by their tracks: split")
        groups[split.instance] = first
        groups.append(second)
    return Regrouping(*form_instances(scene, measured.tracks, _group_of(scene, groups)), tuple(messages))


def _group_of(scene: Scene, groups: Sequence[Members]) -> IntArray:
    """(E,) the group of each element, all key frames in order."""
    of = {member: number for number, members in enumerate(groups) for member in members}
    return np.array([of[k, e] for k, key_frame in enumerate(scene.key_frames) for e in range(len(key_frame.elements))])


def _in_words(scene: Scene, first: tuple[int, int], second: tuple[int, int]) -> str:
    """Two elements by the annotator's ids, because instances change their names here."""
    names = []
    for k, e in (first, second):
        element = scene.key_frames[k].elements[e]
        names.append(f"{element.label} {element.id} of {scene.frame_of(k).name}")
    return " and ".join(names)
