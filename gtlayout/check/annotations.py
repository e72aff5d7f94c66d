"""Elements that contradict each other or themselves."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import shapely
from shapely import LineString

from gtlayout.review.tiling import tiling_findings
from gtlayout.scene import SAME_BORDER_PX, Element, FloatArray, Scene

MIN_KEY_FRAMES = 3
"""With one or two key frames errors of the annotation hardly show, because nothing contradicts them."""
MIN_INSIDE = 0.5
"""Share of an element's visible part that must lie in its polygon."""
MAX_STRAY_PX = 10.0
"""An occlusion edge separates elements, so it runs along their outlines. This far off it has no effect."""
MAX_STRAY_SHARE = 0.5
"""An occlusion edge is suspicious when more than this share of it is so far off."""


def annotation_suspicions(scene: Scene) -> list[str]:
    """Too few key frames; visible parts outside, stray edges, floors over ceilings, by key frame; overlaps."""
    lines = []
    for k, key_frame in enumerate(scene.key_frames):
        name = scene.frame_of(k).name
        lines += [f"{name}: {line}" for line in _visible_outside(key_frame.elements)]
        lines += [f"{name}: {line}" for line in _stray_edges(key_frame.elements, key_frame.occlusion_edges)]
        lines += [f"{name}: {line}" for line in _upside_down(key_frame.elements)]
    overlaps = [finding.line for finding in tiling_findings(scene) if finding.kind == "overlap"]
    return [*_few(scene), *_without_visible(scene), *lines, *overlaps]


def gaps(scene: Scene) -> list[str]:
    """What the drawings leave blank. Only the annotator knows whether it is meant, and can say so."""
    return [finding.line for finding in tiling_findings(scene) if finding.kind == "gap"]


def _few(scene: Scene) -> list[str]:
    if len(scene.key_frames) >= MIN_KEY_FRAMES:
        return []
    return [f"{len(scene.key_frames)} key frame(s) only: annotate at least {MIN_KEY_FRAMES}, from different places"]


def _without_visible(scene: Scene) -> list[str]:
    """Key frames without any visible part; none when no key frame has one, which the readers say."""
    bare = [
        scene.frame_of(k).name
        for k, key_frame in enumerate(scene.key_frames)
        if all(element.visible.is_empty for element in key_frame.elements)
    ]
    if len(bare) == len(scene.key_frames):
        return []
    return [f"{name}: no visible part drawn, so points on furniture are tracked, too" for name in bare]


def _visible_outside(elements: tuple[Element, ...]) -> Iterator[str]:
    for element in elements:
        if element.visible.is_empty:
            continue
        inside = element.visible.intersection(element.amodal).area / element.visible.area
        if inside < MIN_INSIDE:
            yield (
                f"element {element.id} ({element.label}): {1 - inside:.0%} of its visible part lies outside of it; "
                "is it another element's?"
            )


def _upside_down(elements: tuple[Element, ...]) -> Iterator[str]:
    """Of an image that is turned on its side nothing is said: floor and ceiling lie beside each other."""
    floors, ceilings = ([e for e in elements if e.label == label] for label in ("floor", "ceiling"))
    for floor, ceiling in product(floors, ceilings):
        if floor.amodal.bounds[3] <= ceiling.amodal.bounds[1] + SAME_BORDER_PX:
            yield (
                f"floor {floor.id} lies above ceiling {ceiling.id}: swap their labels, or turn image and drawing if "
                "they are upside down"
            )


def _stray_edges(elements: tuple[Element, ...], occlusion_edges: tuple[FloatArray, ...]) -> Iterator[str]:
    near = shapely.union_all([element.amodal.boundary for element in elements]).buffer(MAX_STRAY_PX)
    for points_px in occlusion_edges:
        edge = LineString(points_px)
        stray = edge.difference(near).length / edge.length if edge.length else 0.0
        if stray > MAX_STRAY_SHARE:
            x, y = points_px[0]
            yield (
                f"the occlusion edge from ({x:.0f}, {y:.0f}) is more than {MAX_STRAY_PX:g} px from every outline "
                f"over {stray:.0%} of its length: draw it along the boundary it means"
            )
