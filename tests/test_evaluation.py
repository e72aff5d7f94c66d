"""Evaluation against depth and truth: errors of known size, and the true planes on the real clips."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
import rooms
from rich.console import Console

from gtlayout.edges import EdgeConfig, contact_edges
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.evaluate import Evaluation, evaluate
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.extents import compute_extents
from gtlayout.geometry.hosts import find_hosts
from gtlayout.instances import Extent, Instance, Plane
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import read_truth
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.results.tables import evaluation_table
from gtlayout.scene import FloatArray, Scene

CAMERA = rooms.facing_camera()
LEFT, RIGHT = rooms.facing(0, 0, 50, 80), rooms.facing(50, 0, 100, 80)


def _layout(surfaces: Sequence[rooms.Surface], instances: Sequence[Instance]) -> Layout:
    planes, extents = tuple(s.plane for s in surfaces), tuple(s.extent for s in surfaces)
    return Layout(tuple(instances), planes, extents, build_mesh(instances, extents), metric=True)


def _scene(root: Path, surfaces: Sequence[rooms.Surface], key_frames: int = 1) -> Scene:
    return replace(rooms.seen_from([CAMERA] * key_frames, surfaces), root=root)


def _with_depth(scene: Scene, depth_m: FloatArray) -> Scene:
    """Every frame gets this depth map."""
    path = scene.root / "depth.png"
    assert cv2.imwrite(str(path), np.round(depth_m * 1000).astype(np.uint16))
    return rooms.with_depth(scene, [path] * len(scene.frames))


def _even(depth_m: float) -> npt.NDArray[np.float64]:
    return np.full((CAMERA.height, CAMERA.width), depth_m)


def _write_truth(root: Path, planes: dict[str, Any], elements: dict[str, Any]) -> None:
    data = {"format": "gtlayout-truth/1", "planes": planes, "elements": elements}
    (root / "gt_planes.json").write_text(json.dumps(data))


def _true(surface: rooms.Surface, **more: object) -> dict[str, object]:
    return {"label": surface.label, "normal": surface.plane.normal.tolist(), "d": surface.plane.d, **more}


def _evaluate(scene: Scene, surfaces: Sequence[rooms.Surface]) -> Evaluation:
    return evaluate(scene, _layout(surfaces, rooms.instances_of(surfaces, len(scene.key_frames))))


def test_without_depth_and_truth_there_is_the_iou(tmp_path: Path) -> None:
    found = _evaluate(_scene(tmp_path, [LEFT, RIGHT]), [LEFT, RIGHT])
    assert found.iou == 1.0
    assert found.depth is None
    assert (found.planes, found.missing_planes, found.elements) == ((), (), 0)
    assert found.instances == 2


def test_known_depth_errors(tmp_path: Path) -> None:
    """Half of the pixels 5 cm off, the other half exact but for 40 that are 3 m off."""
    depth = _even(rooms.WALL_DEPTH)
    depth[:, :50] += 0.05
    depth[:2, 50:70] += 3.0
    found = _evaluate(_with_depth(_scene(tmp_path, [LEFT, RIGHT]), depth), [LEFT, RIGHT]).depth
    assert found is not None
    assert (found.pixels, found.missing) == (8000, 0)
    assert found.mean == pytest.approx((4000 * 0.05 + 40 * 3.0) / 8000, abs=1e-5)
    # 80 px go: the 40 gross ones and 40 of those that are 5 cm off.
    assert found.trimmed_mean == pytest.approx(3960 * 0.05 / 7920, abs=1e-5)
    assert found.median == pytest.approx(0.05, abs=1e-5)
    assert found.within_10cm == 7960 / 8000
    (name, mean, pixels), (_, other, _) = found.by_instance
    assert (name, pixels) == ("wall_0", 4000)
    assert [mean, other] == pytest.approx([0.05, 40 * 3.0 / 4000], abs=1e-5)


def test_only_visible_pixels_with_measured_depth_count(tmp_path: Path) -> None:
    """100x80 px, 20 columns without depth, and of the wall only the upper half is visible."""
    wall = rooms.facing(0, 0, 100, 80)
    depth = _even(rooms.WALL_DEPTH + 0.02)
    depth[:, :20] = 0
    depth[40:] = 1.0
    scene = _with_depth(_scene(tmp_path, [wall]), depth)
    (element,) = scene.key_frames[0].elements
    upper = replace(element, visible=rooms.pixels(0, 0, 100, 40))
    scene = replace(scene, key_frames=(replace(scene.key_frames[0], elements=(upper,)),))
    found = _evaluate(scene, [wall]).depth
    assert found is not None
    assert (found.pixels, found.missing) == (80 * 40, 0)
    assert found.mean == pytest.approx(0.02, abs=1e-5)


def test_pixels_without_a_surface_are_counted(tmp_path: Path) -> None:
    """The layout's wall is 30 px narrower than the annotated one."""
    scene = _with_depth(_scene(tmp_path, [rooms.facing(0, 0, 100, 80)], 2), _even(rooms.WALL_DEPTH))
    found = _evaluate(scene, [rooms.facing(30, 0, 100, 80)]).depth
    assert found is not None
    assert (found.pixels, found.missing) == (2 * 70 * 80, 2 * 30 * 80)
    nothing = _evaluate(scene, [rooms.Surface("wall", rooms.facing(0, 0, 100, 80).corners - np.array([0, 20, 0]))])
    assert nothing.iou == 0.0


def test_pixels_within_5_and_10_cm(tmp_path: Path) -> None:
    """100 columns: 10 are 4 cm off, 20 are 8 cm off, 30 are 12 cm off, 25 exact, 15 without a surface."""
    depth = _even(rooms.WALL_DEPTH)
    for left, right, off in ((25, 35, 0.04), (35, 55, 0.08), (55, 85, 0.12)):
        depth[:, left:right] += off
    scene = _with_depth(_scene(tmp_path, [rooms.facing(0, 0, 100, 80)]), depth)
    wall = rooms.facing(0, 0, 85, 80)
    found = _evaluate(scene, [wall]).depth
    assert found is not None
    assert (found.within_5cm, found.within_10cm) == pytest.approx((0.35, 0.55))
    without_unit = _evaluate(replace(scene, metric=False), [wall]).depth
    assert without_unit is not None
    assert (without_unit.within_5cm, without_unit.within_10cm) == (None, None)
    assert without_unit.mean == found.mean


def test_frames_without_depth_are_left_out(tmp_path: Path) -> None:
    scene = _with_depth(_scene(tmp_path, [LEFT, RIGHT], 2), _even(rooms.WALL_DEPTH))
    scene = rooms.with_depth(scene, [scene.frames[0].depth_path, None])
    found = _evaluate(scene, [LEFT, RIGHT]).depth
    assert found is not None
    assert found.pixels == 8000


def test_plane_errors_of_known_size(tmp_path: Path) -> None:
    """The right wall's truth is turned by 2° about an axis 20 cm behind the centroid; the left one's is exact."""
    turned = replace(RIGHT.plane, normal=np.array([np.sin(np.deg2rad(2)), -np.cos(np.deg2rad(2)), 0]))
    centroid = RIGHT.corners.mean(axis=0)
    truth = {"normal": turned.normal.tolist(), "d": float(-turned.normal @ centroid + 0.2), "from_depth": True}
    elements = {"0.png": {"e0": "a", "e1": "b"}}
    _write_truth(tmp_path, {"a": _true(LEFT), "b": truth}, elements)
    found = _evaluate(_scene(tmp_path, [LEFT, RIGHT]), [LEFT, RIGHT])
    assert [(p.truth, p.instance) for p in found.planes] == [("a", "wall_0"), ("b", "wall_1")]
    assert [p.normal_deg for p in found.planes] == pytest.approx([0.0, 2.0], abs=1e-5)
    assert [p.offset for p in found.planes] == pytest.approx([0.0, 0.2], abs=1e-9)
    assert (found.elements, found.elements_on_right_instance) == (2, 2)


def test_truth_without_normal_or_not_from_depth_is_not_compared(tmp_path: Path) -> None:
    """Their elements still say which instance is which. An instance the solver gave up on leaves its truth missing."""
    surfaces = [rooms.facing(x, 0, x + 25, 80) for x in (0, 25, 50, 75)]
    planes = {
        "none": {"normal": None, "d": None},
        "guessed": _true(surfaces[1], from_depth=False),
        "lost": _true(surfaces[2]),
        "good": _true(surfaces[3]),
    }
    _write_truth(tmp_path, planes, {"0.png": {"e0": "none", "e1": "guessed", "e2": "lost", "e3": "good"}})
    layout = _layout(surfaces, rooms.instances_of(surfaces, 1))
    nan = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False)
    nowhere = Extent(layout.extents[2].frame, rooms.NOTHING, rooms.NOTHING)
    layout = replace(
        layout,
        planes=(*layout.planes[:2], nan, layout.planes[3]),
        extents=(*layout.extents[:2], nowhere, layout.extents[3]),
    )
    found = evaluate(_scene(tmp_path, surfaces), layout)
    assert [plane.truth for plane in found.planes] == ["good"]
    assert found.missing_planes == ("lost",)
    assert found.unobservable == ("wall_2",)
    assert (found.elements, found.elements_on_right_instance) == (4, 4)


def test_elements_on_the_wrong_instance_are_counted(tmp_path: Path) -> None:
    """Three frames of two walls; in the last the two are swapped. One-to-one: each truth owns one instance."""
    frames = {f"{k}.png": {"e0": "a", "e1": "b"} for k in range(3)}
    _write_truth(tmp_path, {"a": _true(LEFT), "b": _true(RIGHT)}, frames)
    scene = _scene(tmp_path, [LEFT, RIGHT], 3)

    def right(*members: tuple[tuple[int, int], ...]) -> tuple[int, int]:
        instances = [Instance(f"wall_{i}", "wall", of) for i, of in enumerate(members)]
        found = evaluate(scene, _layout([LEFT, RIGHT, LEFT, RIGHT][: len(members)], instances))
        return found.elements_on_right_instance, found.elements

    assert right(((0, 0), (1, 0), (2, 0)), ((0, 1), (1, 1), (2, 1))) == (6, 6)
    assert right(((0, 1), (1, 1), (2, 1)), ((0, 0), (1, 0), (2, 0))) == (6, 6)
    assert right(((0, 0), (1, 0), (2, 1)), ((0, 1), (1, 1), (2, 0))) == (4, 6)
    # All in one instance: it can stand for one wall only.
    both = tuple((k, e) for k in range(3) for e in (0, 1))
    assert right(both) == (3, 6)
    # One wall in two instances: the larger stands for it.
    assert right(((0, 0), (1, 0)), ((0, 1), (1, 1), (2, 1)), ((2, 0),)) == (5, 6)


def test_truth_that_names_no_element_is_missing(tmp_path: Path) -> None:
    """Also where an instance is left over: nothing says that it is this plane."""
    _write_truth(tmp_path, {"a": _true(LEFT), "b": _true(RIGHT)}, {"0.png": {"e0": "a"}})
    found = _evaluate(_scene(tmp_path, [LEFT, RIGHT], 2), [LEFT, RIGHT])
    assert [plane.truth for plane in found.planes] == ["a"]
    assert found.missing_planes == ("b",)
    assert (found.elements, found.elements_on_right_instance) == (1, 1)


@pytest.mark.parametrize(
    ("planes", "elements"),
    [
        (None, {}),
        ({}, []),
        ({"a": {"d": 1.0}}, {}),
        ({"a": {"normal": [0, 1], "d": 1.0}}, {}),
        ({"a": {"normal": [0, 0, 0], "d": 1.0}}, {}),
        ({"a": {"normal": [float("nan"), 0, 1], "d": 1.0}}, {}),
        ({"a": {"normal": [0, 0, 1], "d": None}}, {}),
        ({"a": [1, 2, 3, 4]}, {}),
        ({"a": {"normal": [0, 0, 1], "d": 1.0}}, {"0.png": {"e0": "b"}}),
        ({"a": {"normal": [0, 0, 1], "d": 1.0}}, {"0.png": ["e0"]}),
        ({"a": {"normal": [0, 0, 1], "d": 1.0}}, {"0.png": {"e0": ["a"]}}),
    ],
)
def test_damaged_truth_is_one_clear_line(tmp_path: Path, planes: Any, elements: Any) -> None:
    _write_truth(tmp_path, planes, elements)
    with pytest.raises(GtlayoutError, match=r"gt_planes\.json") as caught:
        read_truth(_scene(tmp_path, [LEFT]))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "members",
    [((0, 0), (1, 0)), ((0, 0), (0, 1)), ()],
    ids=["more frames than annotated", "more elements than annotated", "fewer elements than annotated"],
)
def test_layout_of_other_annotations_is_one_clear_line(tmp_path: Path, members: tuple[tuple[int, int], ...]) -> None:
    scene = _with_depth(_scene(tmp_path, [LEFT]), _even(rooms.WALL_DEPTH))
    with pytest.raises(GtlayoutError, match="made from other annotations"):
        evaluate(scene, _layout([LEFT], [Instance("wall_0", "wall", members)]))


def test_table_shows_the_figures(tmp_path: Path) -> None:
    _write_truth(tmp_path, {"a": _true(LEFT), "b": _true(RIGHT), "c": _true(RIGHT)}, {"0.png": {"e0": "a", "e1": "b"}})
    scene = _with_depth(_scene(tmp_path, [LEFT, RIGHT]), _even(rooms.WALL_DEPTH + 0.05))
    console = Console(width=120)
    with console.capture() as capture:
        console.print(evaluation_table(_evaluate(scene, [LEFT, RIGHT])))
    text = capture.get()
    found = ("0.00° ± 0.00°, 0.0000 ± 0.0000 m off", "no observable instance", "2 of 2", "1.000, 1.000")
    for figure in ("1.0000 (accepted)", "0.0500 m", *found):
        assert figure in text


def _only_measured(scene: Scene) -> Scene:
    """Without the elements whose true plane is unknown."""
    truth = read_truth(scene)
    assert truth is not None
    known = {member for member, name in truth.elements.items() if np.isfinite(truth.planes[name].normal).all()}
    return replace(
        scene,
        key_frames=tuple(
            replace(key_frame, elements=tuple(x for e, x in enumerate(key_frame.elements) if (k, e) in known))
            for k, key_frame in enumerate(scene.key_frames)
        ),
    )


def test_true_planes_on_the_real_clips(real_clip: Path) -> None:
    """The floor for any estimator: what annotations, depth noise and extents leave, with every plane right."""
    scene = _only_measured(load_scene(real_clip))
    truth = read_truth(scene)
    assert truth is not None
    names = sorted(set(truth.elements.values()))
    members = [tuple(member for member, plane in truth.elements.items() if plane == name) for name in names]
    labels = [scene.key_frames[of[0][0]].elements[of[0][1]].label for of in members]
    alone = [Instance(*parts) for parts in zip(names, labels, members, strict=True)]
    instances = [replace(one, host=host) for one, host in zip(alone, find_hosts(scene, alone), strict=True)]
    planes = [Plane(truth.planes[name].normal, truth.planes[name].d, np.zeros((4, 4)), True) for name in names]
    edges = contact_edges(scene, instances, EdgeConfig())
    extents = compute_extents(scene, instances, planes, edges, ExtentConfig())
    assert all(extent.region.is_valid and not extent.region.is_empty for extent in extents)
    layout = Layout(tuple(instances), tuple(planes), extents, build_mesh(instances, extents), scene.metric)
    found = evaluate(scene, layout)
    assert found.depth is not None
    ceilings = {"office": (0.965, 0.022, 0.012), "redkitchen": (0.945, 0.018, 0.014)}
    least_iou, most_mean, most_trimmed = ceilings[real_clip.name]
    assert found.iou > least_iou
    assert found.depth.mean < most_mean
    assert found.depth.trimmed_mean < most_trimmed
    assert found.depth.missing < 0.01 * found.depth.pixels
    assert found.elements_on_right_instance == found.elements == sum(len(k.elements) for k in scene.key_frames)
    assert {plane.truth for plane in found.planes} == {name for name in names if truth.planes[name].scored}
    assert max(plane.normal_deg for plane in found.planes) < 1e-5
    assert max(plane.offset for plane in found.planes) < 1e-9
