"""After stage 4: what the planes show of the instances, and tracks alone could not.

Tracks alone cannot show that a wall that leaves the image is the one that enters it later, and sometimes they join two
walls. The planes and their covariance show both. They also predict every key frame, so that an element finds back to
its instance, and a drawing that cannot be right is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtlayout.correspondence.matching import form_instances
from gtlayout.extent.config import ExtentConfig
from gtlayout.instances import Instance, Member, Members
from gtlayout.planes.estimate import Estimate
from gtlayout.prepared.measurements import Measurements, Prepared
from gtlayout.regrouping.config import RegroupingConfig
from gtlayout.regrouping.drawings import (
    KeyFrameMatch,
    find_contradictions,
    find_rejoins,
    find_swaps,
    match_key_frames,
)
from gtlayout.regrouping.joins import find_joins
from gtlayout.regrouping.parts import find_parts, reaches_through
from gtlayout.regrouping.splits import find_splits
from gtlayout.scene import IntArray, Scene


@dataclass(frozen=True)
class Regrouping:
    """New instances, and the reasons for them."""

    instances: tuple[Instance, ...]
    track_instance: IntArray
    """(N,) instance of each track, -1 = none."""
    left_out: Members
    """The elements that take no part in the solve: each an instance of its own, without tracks, edges and host."""
    messages: tuple[str, ...]
    """What was joined, split and left out, one line each."""


def regroup(
    prepared: Prepared,
    solved: Estimate,
    config: RegroupingConfig,
    extent: ExtentConfig,
    is_curved: Callable[[int], bool] = lambda _: False,
) -> Regrouping | None:
    """The instances that follow from the solved planes; None when they do not change.

    Drawings that cannot be right spoil the planes: when there are any, they are left out, and all else waits for the
    next solve. An instance that gains or loses elements in another way is not joined with others before that, either.
    What no plane explains because it ``is_curved``, by the index of an instance, is neither split nor left out.
    """
    scene, instances = prepared.scene, prepared.instances
    matches = match_key_frames(scene, instances, solved.planes, config, extent)
    wrong, messages = _wrong_drawings(prepared, matches, config, is_curved)
    if wrong:
        kept = [tuple(member for member in one.members if member not in wrong) for one in instances]
        return formed(prepared, [*kept, *((member,) for member in wrong)], (*prepared.left_out, *wrong), messages)
    groups: list[Members] = [instance.members for instance in instances]
    changed: set[int] = set()
    instance_of = {member: i for i, group in enumerate(groups) for member in group}
    joins = find_joins(scene, instances, solved, config, extent)
    one_plane = {join.instances for join in joins}
    for rejoin in find_rejoins(scene, instances, solved.planes, matches, config):
        member, own, taken = rejoin.member, instance_of[rejoin.member], {k for k, _ in groups[rejoin.instance]}
        settled = member in prepared.left_out or member[0] in taken or is_curved(own)
        # Of two instances in one plane either is predicted: these are joined as a whole.
        if settled or (min(own, rejoin.instance), max(own, rejoin.instance)) in one_plane:
            continue
        if reaches_through(prepared, solved.planes, member, rejoin.instance, config, extent) is None:
            pair = _in_words(scene, groups[rejoin.instance][0], member)
            messages.append(f"{pair} are one plane by where its outline must lie (IoU {rejoin.iou:.2f}): joined")
            groups[rejoin.instance] = (*groups[rejoin.instance], member)
            groups[own] = tuple(each for each in groups[own] if each != member)
            changed |= {own, rejoin.instance}
    for part in find_parts(prepared, solved.planes, config, extent):
        if part.instance not in changed and not is_curved(part.instance):
            groups[part.instance] = tuple(member for member in groups[part.instance] if member != part.member)
            pair = _in_words(scene, groups[part.instance][0], part.member)
            through = instances[part.bound].label
            messages.append(f"{pair} are two planes, because the second would reach through the {through}: split")
            groups.append((part.member,))
            changed.add(part.instance)
    splits = [
        split
        for split in find_splits(prepared, solved.planes, config, extent)
        if split.instance not in changed and not is_curved(split.instance)
    ]
    changed |= {split.instance for split in splits}
    for join in joins:
        if not changed & set(join.instances):
            a, b = join.instances
            pair = _in_words(scene, groups[a][0], groups[b][0])
            messages.append(f"{pair} are one plane (χ² {join.chi2:.1f}): joined")
            groups[a], groups[b] = (*groups[a], *groups[b]), ()
    for split in splits:
        first, second = split.parts
        messages.append(f"{_in_words(scene, first[0], second[0])} are two planes by their tracks: split")
        groups[split.instance] = first
        groups.append(second)
    return formed(prepared, groups, prepared.left_out, messages) if messages else None


def _wrong_drawings(
    prepared: Prepared,
    matches: Sequence[KeyFrameMatch],
    config: RegroupingConfig,
    is_curved: Callable[[int], bool],
) -> tuple[Members, list[str]]:
    """Elements that cannot be right and still take part, and a line on each key frame that has some.

    Exchanged labels come first: the planes that follow from them contradict other drawings, too.
    """
    scene, left_out = prepared.scene, prepared.left_out
    instance_of = {member: i for i, one in enumerate(prepared.instances) for member in one.members}
    wrong: list[Member] = []
    messages: list[str] = []
    for swap in find_swaps(scene, matches, config):
        both = {swap.first, swap.second}
        if not both & {*wrong, *left_out} and not any(is_curved(instance_of[member]) for member in sorted(both)):
            wrong += [swap.first, swap.second]
            first, second = (scene.key_frames[k].elements[e] for k, e in (swap.first, swap.second))
            messages.append(
                f"{scene.frame_of(swap.first[0]).name}: {first.label} {first.id} and {second.label} {second.id} "
                f"swapped? By all other key frames the first is a {second.label} and the second a {first.label}: "
                "both are left out; correct their labels"
            )
    if not wrong:
        for members in find_contradictions(scene, matches, config):
            new = [member for member in members if member not in left_out and not is_curved(instance_of[member])]
            if new:
                wrong += new
                messages.append(_contradiction(scene, new))
    return tuple(wrong), messages


def _contradiction(scene: Scene, members: Sequence[Member]) -> str:
    """What to say of elements of one key frame that contradict all others."""
    k = members[0][0]
    elements = scene.key_frames[k].elements
    named = [f"{elements[e].label} {elements[e].id}" for _, e in members]
    whole = len(members) == len(elements)
    one = whole or len(members) == 1
    return (
        f"{scene.frame_of(k).name}: {'the whole drawing' if whole else ', '.join(named)} "
        f"{'contradicts' if one else 'contradict'} what the other key frames show there and {'is' if one else 'are'} "
        "left out: look whether it is drawn on the right frame and in the right place"
    )


def formed(prepared: Measurements, groups: Sequence[Members], left_out: Members, messages: Sequence[str]) -> Regrouping:
    """The instances of some groups of elements."""
    scene = prepared.scene
    instances, track_instance = form_instances(scene, prepared.tracks, _group_of(scene, groups))
    out = {i for i, instance in enumerate(instances) if set(instance.members) & set(left_out)}
    hosted = tuple(
        replace(instance, host=None) if i in out or instance.host in out else instance
        for i, instance in enumerate(instances)
    )
    sampled = np.column_stack([prepared.tracks.key_frame, prepared.tracks.element])
    idle = np.isin(track_instance, sorted(out))
    for member in left_out:
        idle |= (sampled == member).all(axis=1)
    return Regrouping(hosted, np.where(idle, -1, track_instance), left_out, tuple(messages))


def _group_of(scene: Scene, groups: Sequence[Members]) -> IntArray:
    """(E,) the group of each element, all key frames in order."""
    of = {member: number for number, members in enumerate(groups) for member in members}
    return np.array([of[k, e] for k, key_frame in enumerate(scene.key_frames) for e in range(len(key_frame.elements))])


def _in_words(scene: Scene, first: Member, second: Member) -> str:
    """Two elements by the annotator's ids, because instances change their names here."""
    names = []
    for k, e in (first, second):
        element = scene.key_frames[k].elements[e]
        names.append(f"{element.label} {element.id} of {scene.frame_of(k).name}")
    return " and ".join(names)
