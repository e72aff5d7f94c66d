"""Errors that annotators make, planted in a scene whose drawings are right, one at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Polygon

from gtlayout.edges import ContactEdge
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Instance
from gtlayout.scene import OPENINGS, Element, FloatArray, KeyFrame, Scene
from gtlayout.solution import Solution

MIN_SHARE = 0.02
"""Elements that are spoiled show on at least this share of the image."""
MIN_EDGE_PX = 40.0
"""Edges that are moved are at least this long, px of an image of 640x480."""
SHIFTS_PX = (15.0, 30.0)
SLACK_PX = 5.0
"""Two elements' lines along one edge lie within this, px of an image of 640x480."""
MAX_SAME_IOU = 0.6
"""Another frame's polygon is an error only when it is another polygon."""


@dataclass(frozen=True)
class WrongDrawing:
    """A scene with one error."""

    kind: str
    key_frame: int
    scene: Scene
    elements: tuple[str, ...]
    """Ids of the elements that are wrong; each of them names the error."""
    region_px: MultiPolygon
    """Where it is: for an element that is left out."""


def wrong_drawings(solution: Solution, count: int, seed: int) -> tuple[WrongDrawing, ...]:
    """Up to ``count`` errors of each kind, in different places, drawn at random from all that are possible."""
    rng = np.random.default_rng(seed)
    chosen: list[WrongDrawing] = []
    plants = [_swapped, _left_out, _of_another_frame, _no_occlusion_edge]
    shifts = [partial(_shifted, shift_px=shift_px) for shift_px in SHIFTS_PX]
    for planted in (*(plant(solution) for plant in plants), *(shift(solution) for shift in shifts)):
        possible = list(planted)
        picked = sorted(rng.permutation(len(possible))[:count].tolist())
        chosen += [possible[number] for number in picked]
    return tuple(chosen)


def _swapped(solution: Solution) -> Iterator[WrongDrawing]:
    """Two elements of one key frame have each other's label."""
    scene = solution.scene
    for k, key_frame in enumerate(scene.key_frames):
        for a, b in combinations(_large(scene, k), 2):
            first, second = key_frame.elements[a], key_frame.elements[b]
            known = all(_others(solution.instances, k, e) for e in (a, b))
            if first.label != second.label and known:
                swapped = {a: replace(first, label=second.label), b: replace(second, label=first.label)}
                yield _planted("labels swapped", scene, k, swapped, (first.id, second.id))


def _left_out(solution: Solution) -> Iterator[WrongDrawing]:
    """An element that other key frames show is not drawn."""
    scene = solution.scene
    for k, key_frame in enumerate(scene.key_frames):
        for e in _large(scene, k):
            if _others(solution.instances, k, e) and len(key_frame.elements) > 1:
                element = key_frame.elements[e]
                planted = _planted("element left out", scene, k, {e: None}, (element.id,))
                yield replace(planted, region_px=element.amodal)


def _of_another_frame(solution: Solution) -> Iterator[WrongDrawing]:
    """An element has the polygon that it has in another key frame."""
    scene = solution.scene
    for k, key_frame in enumerate(scene.key_frames):
        for e in _large(scene, k):
            element = key_frame.elements[e]
            for other_k, other_e in _others(solution.instances, k, e):
                other = scene.key_frames[other_k].elements[other_e]
                both = element.amodal.intersection(other.amodal).area
                if both <= MAX_SAME_IOU * (element.amodal.area + other.amodal.area - both):
                    drawn = replace(element, amodal=other.amodal, visible=other.visible)
                    yield _planted("another frame's polygon", scene, k, {e: drawn}, (element.id,))


def _no_occlusion_edge(solution: Solution) -> Iterator[WrongDrawing]:
    """An occlusion edge along which two elements run beside each other is not drawn."""
    scene = solution.scene
    for k, key_frame in enumerate(scene.key_frames):
        scale = scene.frame_of(k).camera.annotation_scale
        for number, points_px in enumerate(key_frame.occlusion_edges):
            near = LineString(points_px).buffer(SLACK_PX * scale)
            along = [element.amodal.boundary.intersection(near).length for element in key_frame.elements]
            order = np.argsort(-np.array(along), kind="stable")[:2]
            if len(order) == 2 and along[order[1]] >= MIN_EDGE_PX * scale:
                edges = key_frame.occlusion_edges
                changed = replace(key_frame, occlusion_edges=(*edges[:number], *edges[number + 1 :]))
                ids = tuple(key_frame.elements[e].id for e in order)
                yield WrongDrawing("occlusion edge dropped", k, _with_key_frame(scene, k, changed), ids, MultiPolygon())


def _shifted(solution: Solution, shift_px: float) -> Iterator[WrongDrawing]:
    """The edge along which two elements touch is drawn beside where it is, in both; as of an image of 640x480."""
    scene, instances = solution.scene, solution.instances
    element_of = {(k, i): e for i, one in enumerate(instances) for k, e in one.members}
    for edge in solution.edges:
        scale = scene.frame_of(edge.key_frame).camera.annotation_scale
        long = np.linalg.norm(edge.points_px[-1] - edge.points_px[0]) >= MIN_EDGE_PX * scale
        if not long or _one_wall(instances, edge):
            continue
        for giving, taking in (edge.instances, edge.instances[::-1]):
            pair = element_of[edge.key_frame, giving], element_of[edge.key_frame, taking]
            planted = _moved_edge(scene, edge.key_frame, pair, edge.points_px, shift_px * scale, scale)
            if planted is not None:
                yield replace(planted, kind=f"edge shifted by {shift_px:.0f} px")


def _moved_edge(
    scene: Scene, k: int, pair: tuple[int, int], points_px: FloatArray, shift_px: float, scale: float
) -> WrongDrawing | None:
    """The second element takes a strip along their edge from the first; None when nothing of that would be left."""
    first, second = (scene.key_frames[k].elements[e] for e in pair)
    along = points_px[-1] - points_px[0]
    along = along / np.linalg.norm(along)
    across = np.array([-along[1], along[0]])
    middle = points_px[len(points_px) // 2]
    side = shapely.Point(middle + 2 * SLACK_PX * scale * across)
    inward = across if first.amodal.covers(side) else -across
    start, end = points_px[0] - shift_px * along, points_px[-1] + shift_px * along
    near, far = -SLACK_PX * scale * inward, shift_px * inward
    strip = Polygon([start + near, end + near, end + far, start + far])
    given = first.amodal.intersection(strip)
    left = polygons(first.amodal.difference(strip))
    taken = polygons(second.amodal.union(given).buffer(0.5).buffer(-0.5))
    if left.area < first.amodal.area / 2:
        return None
    changed = {
        pair[0]: replace(first, amodal=left, visible=polygons(first.visible.intersection(left))),
        pair[1]: replace(second, amodal=taken),
    }
    return _planted("edge shifted", scene, k, changed, (first.id, second.id))


def _one_wall(instances: Sequence[Instance], edge: ContactEdge) -> bool:
    """Whether an edge is that of a door in its wall, which has no two planes."""
    a, b = (instances[i].host if instances[i].host is not None else i for i in edge.instances)
    return a == b


def _large(scene: Scene, k: int) -> list[int]:
    camera = scene.frame_of(k).camera
    elements = scene.key_frames[k].elements
    openings = shapely.union_all([MultiPolygon(), *(e.amodal for e in elements if e.label in OPENINGS)])
    shown = [e.amodal if e.label in OPENINGS else e.amodal.difference(openings) for e in elements]
    return [e for e, region in enumerate(shown) if region.area >= MIN_SHARE * camera.width * camera.height]


def _others(instances: Sequence[Instance], k: int, e: int) -> list[tuple[int, int]]:
    own = next(one.members for one in instances if (k, e) in one.members)
    return [member for member in own if member[0] != k]


def _planted(
    kind: str, scene: Scene, k: int, changed: Mapping[int, Element | None], ids: tuple[str, ...]
) -> WrongDrawing:
    elements = [changed.get(e, element) for e, element in enumerate(scene.key_frames[k].elements)]
    kept = replace(scene.key_frames[k], elements=tuple(element for element in elements if element is not None))
    return WrongDrawing(kind, k, _with_key_frame(scene, k, kept), ids, MultiPolygon())


def _with_key_frame(scene: Scene, k: int, key_frame: KeyFrame) -> Scene:
    key_frames = list(scene.key_frames)
    key_frames[k] = key_frame
    return replace(scene, key_frames=tuple(key_frames))
