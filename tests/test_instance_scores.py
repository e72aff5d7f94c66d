"""Precision and recall of elements against hand-computed cases."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rooms
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.evaluate import Evaluation, evaluate
from gtlayout.instances import Extent, Plane
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.scene import FloatArray

CAMERA = rooms.facing_camera()
LEFT, RIGHT = rooms.facing(0, 0, 50, 80), rooms.facing(50, 0, 100, 80)


def _layout(surfaces: Sequence[rooms.Surface], key_frames: int = 1) -> Layout:
    planes, extents = tuple(s.plane for s in surfaces), tuple(s.extent for s in surfaces)
    instances = rooms.instances_of(surfaces, key_frames)
    return Layout(instances, planes, extents, build_mesh(instances, extents), metric=True)


def _truth_row(surface: rooms.Surface, corners: FloatArray | None = None, **more: object) -> dict[str, Any]:
    extent = [[(surface.corners if corners is None else corners).tolist()]]
    return {"normal": surface.plane.normal.tolist(), "d": surface.plane.d, "extent": extent, **more}


def _evaluate(root: Path, layout: Layout, truth: dict[str, dict[str, Any]], key_frames: int = 1) -> Evaluation:
    """Truth number e belongs to element e of every key frame."""
    elements = {f"{k}.png": {f"e{e}": name for e, name in enumerate(truth)} for k in range(key_frames)}
    data = {"format": "gtlayout-truth/1", "planes": truth, "elements": elements}
    (root / "gt_planes.json").write_text(json.dumps(data))
    drawn = [LEFT, RIGHT][: len(layout.instances)]
    return evaluate(replace(rooms.seen_from([CAMERA] * key_frames, drawn), root=root), layout)


def _turned(surface: rooms.Surface, degrees: float) -> dict[str, Any]:
    """Truth turned about the vertical through the surface's middle."""
    angle = np.deg2rad(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    middle = surface.corners.mean(axis=0)
    normal = turn @ surface.plane.normal
    corners = (surface.corners - middle) @ turn.T + middle
    return {"normal": normal.tolist(), "d": -float(normal @ middle), "extent": [[corners.tolist()]]}


def test_exact_planes_and_extents_are_found(tmp_path: Path) -> None:
    found = _evaluate(tmp_path, _layout([LEFT, RIGHT]), {"a": _truth_row(LEFT), "b": _truth_row(RIGHT)})
    assert (found.precision, found.recall, found.wrong) == (1.0, 1.0, ())


@pytest.mark.parametrize(("degrees", "right"), [(8.9, True), (-8.9, True), (9.1, False), (180.0, False)])
def test_a_normal_may_be_off_by_nine_degrees(tmp_path: Path, degrees: float, right: bool) -> None:
    found = _evaluate(tmp_path, _layout([LEFT, RIGHT]), {"a": _truth_row(LEFT), "b": _turned(RIGHT, degrees)})
    assert (found.precision, found.recall) == ((1.0, 1.0) if right else (0.5, 0.5))
    assert found.wrong == (() if right else ("wall_1",))


@pytest.mark.parametrize(("missing_px", "right"), [(4, True), (6, False)])
def test_an_extent_needs_an_iou_of_nine_tenths(tmp_path: Path, missing_px: int, right: bool) -> None:
    """Of 50 px of width: IoU 46 / 50 = .92 and 44 / 50 = .88."""
    narrow = rooms.facing(50, 0, 100 - missing_px, 80)
    found = _evaluate(tmp_path, _layout([LEFT, narrow]), {"a": _truth_row(LEFT), "b": _truth_row(RIGHT)})
    assert found.precision == (1.0 if right else 0.5)


def test_holes_of_the_true_extent_count(tmp_path: Path) -> None:
    """A quarter of the true wall is a hole that the layout fills: IoU .75."""
    row = _truth_row(RIGHT)
    hole = rooms.facing(62.5, 20, 87.5, 60).corners[::-1]
    row["extent"][0].append(hole.tolist())
    found = _evaluate(tmp_path, _layout([LEFT, RIGHT]), {"a": _truth_row(LEFT), "b": row})
    assert found.wrong == ("wall_1",)


def test_a_plane_without_true_normal_asks_for_its_extent_only(tmp_path: Path) -> None:
    turned = _turned(RIGHT, 30.0)
    unknown = {**turned, "from_depth": False, "extent": None}
    found = _evaluate(tmp_path, _layout([LEFT, RIGHT]), {"a": _truth_row(LEFT), "b": unknown})
    assert (found.precision, found.recall) == (1.0, 1.0)


def test_an_instance_too_many_costs_precision_an_element_lost_recall(tmp_path: Path) -> None:
    truth = {"a": _truth_row(LEFT), "b": _truth_row(RIGHT)}
    elements = {"0.png": {"e0": "a", "e1": "a"}}
    data = {"format": "gtlayout-truth/1", "planes": truth, "elements": elements}
    (tmp_path / "gt_planes.json").write_text(json.dumps(data))
    scene = replace(rooms.seen_from([CAMERA], [LEFT, RIGHT]), root=tmp_path)
    # One true plane drawn as two elements: one instance stands for it, the other for nothing.
    found = evaluate(scene, _layout([LEFT, RIGHT]))
    assert (found.precision, found.recall) == (0.5, 1.0)


def test_two_true_planes_in_one_instance_cost_recall(tmp_path: Path) -> None:
    """Two frames, another wall in each, taken for one."""
    data = {
        "format": "gtlayout-truth/1",
        "planes": {"a": _truth_row(LEFT), "b": _truth_row(RIGHT)},
        "elements": {"0.png": {"e0": "a"}, "1.png": {"e0": "b"}},
    }
    (tmp_path / "gt_planes.json").write_text(json.dumps(data))
    found = evaluate(replace(rooms.seen_from([CAMERA] * 2, [LEFT]), root=tmp_path), _layout([LEFT], 2))
    assert (found.precision, found.recall) == (1.0, 0.5)


def test_unobservable_and_empty_elements_are_wrong_not_fatal(tmp_path: Path) -> None:
    layout = _layout([LEFT, RIGHT])
    lost = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False)
    nowhere = Extent(layout.extents[1].frame, MultiPolygon(), MultiPolygon())
    truth = {"a": _truth_row(LEFT), "b": _truth_row(RIGHT)}
    found = _evaluate(
        tmp_path, replace(layout, planes=(layout.planes[0], lost), extents=(layout.extents[0], nowhere)), truth
    )
    assert (found.precision, found.recall, found.wrong) == (0.5, 0.5, ("wall_1",))
    empty = _evaluate(tmp_path, replace(layout, extents=(layout.extents[0], nowhere)), truth)
    assert empty.wrong == ("wall_1",)


def test_without_truth_the_annotations_decide(tmp_path: Path) -> None:
    """The second instance covers half of what is drawn, in every frame."""
    scene = replace(rooms.seen_from([CAMERA] * 3, [LEFT, RIGHT]), root=tmp_path)
    found = evaluate(scene, _layout([LEFT, rooms.facing(50, 0, 75, 80)], 3))
    assert (found.precision, found.recall, found.wrong) == (0.5, 0.5, ("wall_1",))


def test_an_element_of_one_frame_counts_like_any_other(tmp_path: Path) -> None:
    scene = replace(rooms.seen_from([CAMERA] * 2, [LEFT, RIGHT]), root=tmp_path)
    scene = replace(
        scene, key_frames=(scene.key_frames[0], replace(scene.key_frames[1], elements=scene.key_frames[1].elements[:1]))
    )
    layout = _layout([LEFT, RIGHT], 2)
    layout = replace(layout, instances=(layout.instances[0], replace(layout.instances[1], members=((0, 1),))))
    found = evaluate(scene, layout)
    assert (found.precision, found.recall) == (1.0, 1.0)


@pytest.mark.parametrize("extent", [[[[[0, 0], [1, 0], [1, 1]]]], [[[[0, 0, 0], [1, 0, 0]]]], [[["x"]]], 3])
def test_a_damaged_true_extent_is_one_clear_line(tmp_path: Path, extent: object) -> None:
    with pytest.raises(GtlayoutError, match=r"gt_planes\.json: a plane is damaged"):
        _evaluate(tmp_path, _layout([LEFT, RIGHT]), {"a": _truth_row(LEFT, extent=extent), "b": _truth_row(RIGHT)})


def test_the_predicted_sigma_stands_beside_the_error(tmp_path: Path) -> None:
    """Only d is uncertain, by 3 cm: the offset is by as much, the normal not at all."""
    layout = _layout([LEFT, RIGHT])
    uncertain = replace(layout.planes[1], covariance=np.diag([0, 0, 0, 0.03**2]))
    layout = replace(layout, planes=(layout.planes[0], uncertain))
    found = _evaluate(tmp_path, layout, {"a": _truth_row(LEFT), "b": _truth_row(RIGHT)})
    assert [plane.sigma_offset for plane in found.planes] == pytest.approx([0.0, 0.03])
    assert [plane.sigma_normal_deg for plane in found.planes] == [0.0, 0.0]
