"""Elements against what all other key frames predict: label, place, shape, and what is not drawn."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.instances import Member
from gtlayout.regrouping.drawings import KeyFrameMatch
from gtlayout.review.config import ReviewConfig
from gtlayout.review.findings import Finding, image_area, named, opened, outline
from gtlayout.scene import OPENINGS, Element
from gtlayout.solution import Solution


def match_findings(
    solution: Solution, found: KeyFrameMatch, missing: Mapping[int, MultiPolygon], config: ReviewConfig
) -> tuple[Finding, ...]:
    """All that is wrong with the elements of one key frame, if what the others predict in it is right.

    ``missing``: by instance where it is seen in this key frame and not drawn.
    """
    elements = solution.scene.key_frames[found.key_frame].elements
    labels = {e: i for e, i in _matched(found) if _other_label(found, elements[e], e, i, config)}
    astray = [e for e in range(len(elements)) if e not in labels and _astray(solution, found, e, config)]
    moved = {e: i for e, i in _moved(found, missing, config) if e not in (*labels, *astray)}
    area = np.array([element.amodal.area for element in elements])
    findings = [_label(solution, found, e, i) for e, i in labels.items()]
    findings += [_another_place(solution, found, e, i) for e, i in moved.items()]
    findings += [_not_drawn(solution, found, i, shown) for i, shown in missing.items() if i not in moved.values()]
    if area[astray].sum() > config.min_whole_share * area.sum():
        findings.append(_another_drawing(solution, found, float(area[astray].sum() / area.sum())))
    else:
        findings += [_another_place(solution, found, e, int(found.own[e])) for e in astray]
    return (*findings, *_shapes(solution, found, {*labels, *astray, *moved}, missing, config))


def missing_instances(
    solution: Solution, matches: Sequence[KeyFrameMatch], config: ReviewConfig
) -> list[dict[int, MultiPolygon]]:
    """By key frame the instances that others show on its image and nobody drew, each with where.

    One that fewer key frames draw than should and do not is what is wrong, not its absence.
    """
    unseen = [dict(_unseen(solution, found, config)) for found in matches]
    count = Counter(i for one in unseen for i in one)
    return [{i: at for i, at in one.items() if count[i] <= len(solution.instances[i].members)} for one in unseen]


def _unseen(solution: Solution, found: KeyFrameMatch, config: ReviewConfig) -> Iterator[tuple[int, MultiPolygon]]:
    scene, k = solution.scene, found.key_frame
    scale = scene.frame_of(k).camera.annotation_scale
    elements = scene.key_frames[k].elements
    # A wall may look like the window that is not drawn in it, but it is not drawn as that.
    there = {
        *found.own.tolist(),
        *(i for e, i in _matched(found) if found.labels[i] == elements[e].label),
        *(i for e, i in _matched(found) if _other_label(found, elements[e], e, i, config)),
    }
    for i, region in enumerate(found.prediction.visible):
        if i in there or region.is_empty:
            continue
        shown = opened(region.difference(scene.key_frames[k].blank), config.shape_opening_px * scale)
        if shown.area >= config.min_missing_share * image_area(scene, k):
            yield i, shown


def _matched(found: KeyFrameMatch) -> list[Member]:
    """Elements, each with the instance that it looks like."""
    return [(e, i) for e, i in enumerate(found.matched) if i is not None]


def _other_label(found: KeyFrameMatch, element: Element, e: int, i: int, config: ReviewConfig) -> bool:
    known = min(found.overlap.known_share[e], found.overlap.drawn_share[i]) >= config.min_known_share
    return found.labels[i] != element.label and bool(known and found.overlap.iou[e, i] >= config.min_label_iou)


def _astray(solution: Solution, found: KeyFrameMatch, e: int, config: ReviewConfig) -> bool:
    """Whether an element is drawn where the others show something else. One that nobody else knows need not be."""
    i = found.matched[e]
    if i is not None and found.labels[i] == found.labels[found.own[e]]:
        return False
    compared = found.others[e] > 0 or not solution.planes[found.own[e]].observable
    known = found.overlap.known_share[e] >= config.min_known_share
    return bool(compared and known and found.own_iou[e] < config.max_placed_iou)


def _moved(found: KeyFrameMatch, missing: Mapping[int, MultiPolygon], config: ReviewConfig) -> Iterator[Member]:
    """Elements that nobody else knows, on something that others know, each with the missing instance of its label."""
    left = sorted(missing, key=lambda i: -missing[i].area)
    for e, own in enumerate(found.own):
        known = found.overlap.known_share[e] >= config.min_known_share
        if found.others[e] == 0 and found.matched[e] is None and known:
            i = next((i for i in left if found.labels[i] == found.labels[own]), None)
            if i is not None:
                left.remove(i)
                yield e, i


def _label(solution: Solution, found: KeyFrameMatch, e: int, i: int) -> Finding:
    element = solution.scene.key_frames[found.key_frame].elements[e]
    return Finding(
        found.key_frame,
        solution.scene.frame_of(found.key_frame).name,
        element.id,
        None,
        "label",
        f"{named(element)} is a {found.labels[i]} in the other key frames ({_elsewhere(solution, found, i)}): correct "
        "its label",
        float(found.overlap.iou[e, i]),
        outline(element.amodal),
        outline(found.prediction.visible[i]),
    )


def _another_place(solution: Solution, found: KeyFrameMatch, e: int, i: int) -> Finding:
    """Element ``e``, which should be where instance ``i`` is."""
    element = solution.scene.key_frames[found.key_frame].elements[e]
    predicted, iou = found.prediction.visible[i], float(found.overlap.iou[e, i])
    return Finding(
        found.key_frame,
        solution.scene.frame_of(found.key_frame).name,
        element.id,
        None,
        "another place",
        f"{named(element)} is drawn where the other key frames show something else (IoU {iou:.2f}): look whether it "
        "is in the right place",
        1 - iou,
        outline(element.amodal),
        None if predicted.is_empty else outline(predicted),
    )


def _another_drawing(solution: Solution, found: KeyFrameMatch, share: float) -> Finding:
    camera = solution.scene.frame_of(found.key_frame).camera
    return Finding(
        found.key_frame,
        solution.scene.frame_of(found.key_frame).name,
        None,
        None,
        "another place",
        f"the drawing contradicts what the other key frames show there, over {share:.0%} of its area: look whether it "
        "is drawn on the right frame",
        share,
        outline(shapely.box(0, 0, camera.width, camera.height)),
    )


def _not_drawn(solution: Solution, found: KeyFrameMatch, i: int, shown: MultiPolygon) -> Finding:
    scene, k = solution.scene, found.key_frame
    share = shown.area / image_area(scene, k)
    return Finding(
        k,
        scene.frame_of(k).name,
        None,
        None,
        "missing",
        f"the {found.labels[i]} that is {_elsewhere(solution, found, i)} is not drawn, though {share:.1%} of the image "
        "show it: draw it, or what hides it",
        share,
        outline(shown),
        outline(shown),
    )


def _shapes(
    solution: Solution,
    found: KeyFrameMatch,
    wrong: Collection[int],
    missing: Collection[int],
    config: ReviewConfig,
) -> Iterator[Finding]:
    """Elements that are not in the right place everywhere, but for those ``wrong`` in another way."""
    scene, k = solution.scene, found.key_frame
    elements, visible = scene.key_frames[k].elements, found.prediction.visible
    radius = config.shape_opening_px * scene.frame_of(k).camera.annotation_scale
    drawn = _drawn(elements)
    for e, element in enumerate(elements):
        own = visible[found.own[e]]
        if e in wrong or own.is_empty or found.others[e] < config.min_others:
            continue
        if found.overlap.known_share[e] < config.min_known_share:
            continue
        # Where nothing is drawn there is a gap, and where nothing is predicted nobody else has looked.
        others_drawn = shapely.union_all([region for f, region in enumerate(drawn) if f != e])
        others = [region for i, region in enumerate(visible) if i != found.own[e] and i not in missing]
        others_shown = shapely.union_all([MultiPolygon(), *others])
        lost = opened(own.intersection(others_drawn), radius)
        extra = opened(drawn[e].intersection(others_shown), radius)
        parts = [(lost, lost.area / own.area), (extra, extra.area / max(drawn[e].area, 1.0))]
        region, share = max(parts, key=lambda part: part[1])
        if share >= config.min_shape_share:
            where = "beyond what it is" if region is extra else "as something else than"
            yield Finding(
                k,
                scene.frame_of(k).name,
                element.id,
                None,
                "shape",
                f"{named(element)}: {share:.0%} of it is drawn {where} in the other key frames: compare them",
                share,
                outline(region),
                outline(own),
            )


def _drawn(elements: tuple[Element, ...]) -> list[BaseGeometry]:
    """What is drawn of each element that no door or window lies on."""
    openings = shapely.union_all([MultiPolygon(), *(e.amodal for e in elements if e.label in OPENINGS)])
    return [e.amodal if e.label in OPENINGS else e.amodal.difference(openings) for e in elements]


def _elsewhere(solution: Solution, found: KeyFrameMatch, i: int) -> str:
    """An instance by its largest element in another key frame."""
    scene = solution.scene
    others = [(k, e) for k, e in solution.instances[i].members if k != found.key_frame]
    k, e = max(others, key=lambda member: scene.key_frames[member[0]].elements[member[1]].amodal.area)
    return f"{scene.key_frames[k].elements[e].id} of {scene.frame_of(k).name}"
