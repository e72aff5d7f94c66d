"""The verdict on a scene in one word, with its reasons: what the user should do with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from gtlayout.figures import figure, is_known, percent, short
from gtlayout.instances import Extent, Instance
from gtlayout.quality.config import QualityConfig
from gtlayout.quality.measures import ElementIoU, InstanceQuality, Measures
from gtlayout.scene import Scene

Word = Literal["trust", "check", "redo"]
"""Use it as it is; look at what is named before it is used; not usable without new elements or cameras."""
_NAMED = 3
"""Instances that a sentence names."""


@dataclass(frozen=True)
class Headline:
    """What to do with a scene."""

    word: Word
    reasons: tuple[str, ...]
    """Sentences that name a frame, an element or an instance, a number, and what to do. The most important comes first;
    never empty."""


def headline(
    scene: Scene,
    instances: Sequence[Instance],
    extents: Sequence[Extent],
    measures: Measures,
    config: QualityConfig,
    unit_doubt: str | None = None,
) -> Headline:
    """*Redo* if there is any reason for it, else *check* if there is any, else *trust*. All reasons are given.

    *Redo*: depth is known for less than ``config.min_known_share`` of what is drawn, or the IoU is not accepted.

    *Check*: the unit cannot be right (``unit_doubt`` says why); an instance is unobservable, or the σ of its depth is
    as large as its depth; a key frame's IoU is below ``config.min_frame_iou``; an extent is out of all proportion
    (``config.max_reach``); the predicted verdict is doubtful; instances that are ok have less than
    ``config.min_ok_share`` of the drawn pixels.
    """
    redo = list(_redo(scene, instances, measures, config))
    check = [*([unit_doubt] if unit_doubt else []), *_check(scene, instances, extents, measures, config)]
    if redo or check:
        return Headline("redo" if redo else "check", (*redo, *check))
    return Headline("trust", (_good(measures),))


def element_name(scene: Scene, instances: Sequence[Instance], element: ElementIoU) -> str:
    """The instance, the annotator's id of the element and its frame: ``wall_1 = e2 in 000010.jpg``."""
    drawn = scene.key_frames[element.key_frame].elements[element.element].id
    return f"{instances[element.instance].name} = {drawn} in {scene.frame_of(element.key_frame).name}"


def _redo(scene: Scene, instances: Sequence[Instance], measures: Measures, config: QualityConfig) -> Iterator[str]:
    if measures.known_share < config.min_known_share:
        yield (
            f"depth is known to {percent(config.known_sigma_depth_share)} for only {percent(measures.known_share)} of "
            "what is drawn: film again with more motion sideways, or give better cameras"
        )
    if not measures.accepted:
        worst = measures.elements[measures.worst_element]
        placed = _is_placed(measures.instances[worst.instance])
        first = f"{element_name(scene, instances, worst)} ({figure(worst.iou, 3)})"
        yield f"IoU {figure(measures.iou, 3)} is below {config.accept_iou:g}: " + (
            f"redraw {first} first" if placed else f"worst is {first}, whose depth is not known"
        )


def _check(
    scene: Scene,
    instances: Sequence[Instance],
    extents: Sequence[Extent],
    measures: Measures,
    config: QualityConfig,
) -> Iterator[str]:
    names, judged = [instance.name for instance in instances], measures.instances
    lost = [i for i, one in enumerate(judged) if one.verdict == "unobservable"]
    if lost:
        yield f"{_some(names, lost)} unobservable: draw more frames that show where they meet others, or leave them out"
    if unknown := [i for i, one in enumerate(judged) if i not in lost and not _is_placed(one)]:
        yield f"{_some(names, unknown)} of unknown depth: the σ is as large as the depth itself"
    if low := [k for k, iou in enumerate(measures.frames) if iou < config.min_frame_iou]:
        lowest = scene.frame_of(measures.worst_frame).name
        yield (
            f"{len(low)} of {len(measures.frames)} key frames {'is' if len(low) == 1 else 'are'} below an IoU of "
            f"{config.min_frame_iou:g}: look at the elements and the camera of {lowest} "
            f"({figure(measures.frames[measures.worst_frame], 3)}) first"
        )
    if far := [i for i, one in enumerate(judged) if one.reach > config.max_reach]:
        worst = max(far, key=lambda i: judged[i].reach)
        yield (
            f"{_some(names, far)} out of all proportion to what was seen of the room: look at {names[worst]} first, "
            f"whose {short(extents[worst].region.area)} {'m²' if scene.metric else 'u²'} reach "
            f"{short(judged[worst].reach)} times as far as the room"
        )
    if measures.predicted == "doubtful":
        blamed = max(range(len(judged)), key=lambda i: _blame(judged[i]))
        yield (
            f"σ of depth is {percent(measures.sigma_depth_share, 1)} in the mean, more than "
            f"{100 * config.trusted_sigma_depth_share:g} %: look at {names[blamed]} first, which adds most"
        )
    good = [one for one in judged if one.verdict == "ok"]
    others = [i for i, one in enumerate(judged) if one.verdict != "ok"]
    if others and _share(good) < config.min_ok_share:
        largest = names[max(others, key=lambda i: judged[i].drawn_share)]
        yield (
            f"only {len(good)} of {len(judged)} instances, {percent(_share(good))} of what is drawn, are ok: "
            f"look at {largest} first, the largest of the others"
            if good
            else f"no instance is ok: look at {largest} first, the largest"
        )


def _good(measures: Measures) -> str:
    good = [one for one in measures.instances if one.verdict == "ok"]
    some = f"{len(good)} of {len(measures.instances)} instances, {percent(_share(good))} of what is drawn, are ok"
    return (
        f"IoU {figure(measures.iou, 3)}, σ of depth {percent(measures.sigma_depth_share, 1)}; "
        f"{some if len(good) < len(measures.instances) else 'all instances are ok'}"
    )


def _is_placed(one: InstanceQuality) -> bool:
    """Whether anything is known of an instance's depth."""
    return one.verdict != "unobservable" and is_known(one.sigma_depth, one.depth)


def _share(judged: Sequence[InstanceQuality]) -> float:
    """Of the drawn pixels."""
    return float(sum(one.drawn_share for one in judged))


def _blame(one: InstanceQuality) -> float:
    """What an instance adds to the mean σ of depth."""
    return one.drawn_share * (one.sigma_depth / one.depth if _is_placed(one) else 1.0)


def _some(names: Sequence[str], chosen: Sequence[int]) -> str:
    """``wall_1 is``, ``wall_0, wall_1, wall_2 and 4 more are``."""
    shown = ", ".join(names[i] for i in chosen[:_NAMED])
    rest = f" and {len(chosen) - _NAMED} more" if len(chosen) > _NAMED else ""
    return f"{shown}{rest} {'is' if len(chosen) == 1 else 'are'}"
