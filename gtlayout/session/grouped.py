"""The instances of another drawing of a scene: as before, with new elements added to them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

from gtlayout.config import Config
from gtlayout.correspondence.matching import correspond
from gtlayout.instances import Member
from gtlayout.prediction.config import PredictionConfig
from gtlayout.prediction.matching import match, overlap
from gtlayout.prediction.predict import predict
from gtlayout.prepared.measurements import Prepared
from gtlayout.regrouping.regroup import Regrouping, formed
from gtlayout.session.redrawing import Redrawing
from gtlayout.session.tracked import Tracked
from gtlayout.solution import Solution


@dataclass(frozen=True)
class Grouped:
    """Instances, and which they were."""

    regrouping: Regrouping
    origin: tuple[int | None, ...]
    """Of each instance its index before; None for a new one."""


def grouped(prepared: Prepared, solution: Solution, redrawing: Redrawing, tracked: Tracked, config: Config) -> Grouped:
    """Elements that were there stay with their instance, unless their label has changed.

    Others join the instance whose elements their tracks vote for, else the one that is predicted where they are drawn.
    The rest are new instances.
    """
    group_before = {member: i for i, instance in enumerate(prepared.instances) for member in instance.members}
    group_of = {
        member: group_before[redrawing.was[member]] for member in redrawing.members if redrawing.same_surface(member)
    }
    new = [member for member in redrawing.members if member not in group_of]
    if new:
        group_of |= _joined(prepared, solution, redrawing, tracked, group_of, new, config)
    groups: dict[int, list[Member]] = {}
    for member in redrawing.members:
        groups.setdefault(group_of[member], []).append(member)
    out = tuple(
        member
        for member in redrawing.members
        if redrawing.same_surface(member) and redrawing.was[member] in prepared.left_out
    )
    scene = replace(prepared, scene=redrawing.scene, tracks=tracked.tracks, rays=tracked.rays)
    regrouping = formed(scene, [tuple(members) for members in groups.values()], out, ())
    origin = [group_of[instance.members[0]] for instance in regrouping.instances]
    return Grouped(regrouping, tuple(i if i < len(prepared.instances) else None for i in origin))


def _joined(
    prepared: Prepared,
    solution: Solution,
    redrawing: Redrawing,
    tracked: Tracked,
    group_of: dict[Member, int],
    new: list[Member],
    config: Config,
) -> dict[Member, int]:
    """The group of each new element; numbers from that of the instances on are new groups."""
    suggested, _ = correspond(redrawing.scene, tracked.tracks, tracked.rays, config.correspondence)
    together = {member: instance.members for instance in suggested for member in instance.members}
    found: dict[Member, int] = {}

    def is_free(group: int, member: Member) -> bool:
        return not any(k == member[0] and g == group for of in (group_of, found) for (k, _), g in of.items())

    for member in new:
        votes = Counter(group_of[other] for other in together[member] if other in group_of)
        # The smallest number of those with most votes.
        for group in sorted(votes, key=lambda group: (-votes[group], group)):
            if is_free(group, member):
                found[member] = group
                break
    for k in sorted({member[0] for member in new if member not in found}):
        for e, shown in enumerate(_predicted(solution, redrawing, k)):
            if shown is not None and (k, e) in new and (k, e) not in found and is_free(shown, (k, e)):
                found[k, e] = shown
    number = len(prepared.instances)
    for member in new:
        if member not in found:
            for other in together[member]:
                if other in new and other not in found:
                    found[other] = number
            number += 1
    return found


def _predicted(solution: Solution, redrawing: Redrawing, k: int) -> list[int | None]:
    """The instance before, of the same label, that each element of a key frame shows by its place."""
    elements = redrawing.scene.key_frames[k].elements
    layout, given = solution.layout, redrawing.form.given.key_frames[k].frame
    seen = predict(layout.planes, layout.extents, layout.instances, solution.scene.frames[given].camera)
    labels = [instance.label for instance in layout.instances]
    matched = match(overlap(elements, seen), [e.label for e in elements], labels, PredictionConfig())
    return [
        i if i is not None and labels[i] == element.label else None
        for i, element in zip(matched, elements, strict=True)
    ]
