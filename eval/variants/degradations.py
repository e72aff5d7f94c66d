"""All ways in which a scene is spoiled, by name. A name is its kind and, after a colon, what exactly was chosen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.truth import read_truth
from gtlayout.scene import Scene
from variants.spoiled_cameras import Cameras, spoiled_cameras
from variants.spoiled_elements import (
    Drawn,
    drawn,
    jittered,
    largest,
    largest_of_another_label,
    longest_edge,
    shifted_edge,
    shifted_element,
    swapped_labels,
    visible_on_furniture,
)
from variants.variant import Makers, Variant, all_drawn, redrawn, variant, with_cameras, with_key_frames

SHIFTS_PX = (15.0, 30.0)
JITTER_PX = 8.0
LATER = 10
"""Frames between elements and the image that they are put on."""


def degradations(scene: Scene) -> Makers:
    """Name → how to make ``scene`` so spoiled. Raises GtlayoutError when it has no truth."""
    makers: Makers = {"unspoiled": lambda _folder: variant(scene, scene, all_drawn(scene))}
    for name, cameras in spoiled_cameras(scene).items():
        makers[name] = partial(_with_cameras, scene, cameras)
    return makers | _fewer_key_frames(scene) | _other_drawings(scene)


def kind_of(name: str) -> str:
    """The kind of degradation that a name begins with."""
    return name.split(": ", 1)[0]


def _with_cameras(scene: Scene, cameras: Callable[[], Cameras], _folder: Path) -> Variant:
    spoiled = cameras()
    return variant(scene, with_cameras(scene, spoiled), all_drawn(scene), spoiled)


def _fewer_key_frames(scene: Scene) -> Makers:
    count = len(scene.key_frames)
    kept = {
        f"key frame dropped: {scene.frame_of(k).name}": [j for j in range(count) if j != k]
        for k in range(count)
        if count > 1
    }
    kept["only the first two key frames"] = [0, 1]
    kept["only the first and the last key frame"] = [0, count - 1]
    return {name: partial(_keep, scene, of) for name, of in kept.items() if len(of) < count}


def _keep(scene: Scene, kept: Sequence[int], _folder: Path) -> Variant:
    return variant(scene, with_key_frames(scene, kept), [all_drawn(scene)[k] for k in kept])


def _other_drawings(scene: Scene) -> Makers:
    truth = read_truth(scene)
    if truth is None:
        raise GtlayoutError(f"{scene.root}: no gt_planes.json, so nothing to compare planes with")
    middle = len(scene.key_frames) // 2
    key_frame, camera, where = scene.key_frames[middle], scene.frame_of(middle).camera, scene.frame_of(middle).name
    elements = drawn(key_frame)
    chosen = largest([pair for pair in elements if (middle, pair[0]) in truth.elements] or elements, ("wall",))
    true_name = truth.elements.get((middle, chosen), "")
    named = f"{_called(elements, chosen)} ({true_name}) in {where}"
    new: dict[str, Callable[[], Mapping[int, Drawn]]] = {}
    if (other := largest_of_another_label(elements, chosen)) is not None:
        pair = f"labels swapped: {_called(elements, chosen)} and {_called(elements, other)} in {where}"
        new[pair] = lambda: {middle: swapped_labels(elements, chosen, other)}
    edge = longest_edge(key_frame.elements[chosen], camera)
    for shift in SHIFTS_PX:
        if edge is not None:
            new[f"edge shifted {shift:g} px: longest of {named}"] = partial(
                lambda edge, shift: {middle: shifted_edge(elements, edge, shift, camera)}, edge, shift
            )
        new[f"element shifted {shift:g} px: {named}"] = partial(
            lambda shift: {middle: shifted_element(elements, chosen, np.array([shift, 0.0]), camera)}, shift
        )
    new[f"vertices jittered {JITTER_PX:g} px"] = lambda: _all_jittered(scene)
    new[f"element left out: {named}"] = lambda: {middle: [pair for pair in elements if pair[0] != chosen]}
    if true_name:
        new[f"element left out everywhere: {true_name}"] = lambda: {
            k: [pair for pair in drawn(of) if truth.elements.get((k, pair[0])) != true_name]
            for k, of in enumerate(scene.key_frames)
        }
    new["visible parts on furniture"] = lambda: {
        k: visible_on_furniture(drawn(of)) for k, of in enumerate(scene.key_frames)
    }
    makers: Makers = {name: partial(_drawn_anew, scene, changed) for name, changed in new.items()}
    if any(of.occlusion_edges for of in scene.key_frames):
        makers["no occlusion edges"] = partial(_without_occlusion_edges, scene)
    if (frame := _another_time(scene, middle)) is not None:
        name = f"drawing of another time: {where} on {scene.frames[frame].name}"
        makers[name] = partial(_on_another_frame, scene, middle, frame)
    return makers


def _called(elements: Drawn, number: int) -> str:
    element = elements[number][1]
    return f"{element.label} {element.id}"


def _all_jittered(scene: Scene) -> Mapping[int, Drawn]:
    rng = np.random.default_rng(0)
    return {
        k: jittered(drawn(key_frame), JITTER_PX, scene.frame_of(k).camera, rng)
        for k, key_frame in enumerate(scene.key_frames)
    }


def _drawn_anew(scene: Scene, change: Callable[[], Mapping[int, Drawn]], _folder: Path) -> Variant:
    """Key frames on which nothing is left are none."""
    changed = change()
    kept = [k for k in range(len(scene.key_frames)) if changed.get(k) != []]
    spoiled = redrawn(
        scene,
        {k: replace(scene.key_frames[k], elements=tuple(element for _, element in of)) for k, of in changed.items()},
    )
    sources = [(k, [e for e, _ in changed.get(k, drawn(scene.key_frames[k]))]) for k in kept]
    return variant(scene, with_key_frames(spoiled, kept), sources)


def _without_occlusion_edges(scene: Scene, _folder: Path) -> Variant:
    bare = {k: replace(key_frame, occlusion_edges=()) for k, key_frame in enumerate(scene.key_frames)}
    return variant(scene, redrawn(scene, bare), all_drawn(scene))


def _another_time(scene: Scene, k: int) -> int | None:
    """The frame without annotation that is nearest to ``LATER`` frames after key frame ``k``; None without one."""
    taken = {key_frame.frame for key_frame in scene.key_frames}
    free = [i for i in range(len(scene.frames)) if i not in taken]
    return min(free, key=lambda i: abs(i - scene.key_frames[k].frame - LATER), default=None)


def _on_another_frame(scene: Scene, k: int, frame: int, _folder: Path) -> Variant:
    """Key frames stay in the order of the video."""
    moved = redrawn(scene, {k: replace(scene.key_frames[k], frame=frame)})
    order = sorted(range(len(scene.key_frames)), key=lambda j: moved.key_frames[j].frame)
    return variant(scene, with_key_frames(moved, order), [all_drawn(scene)[j] for j in order])
