"""A solve of a room with a bay: its wall stays one and becomes a cylinder, by itself or because someone says so."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtlayout import method
from gtlayout.config import Config
from gtlayout.curved.strips import drawn_curved, find_curved
from gtlayout.io.scene_folder import load_scene
from gtlayout.measurement import Measurement
from gtlayout.method import Solved, lay_out, regrouped, with_measurements
from gtlayout.observer import Stages
from gtlayout.planes.estimate import Estimate
from gtlayout.regrouping import regroup as regrouping
from gtlayout.regrouping.regroup import regroup
from gtlayout.regrouping.splits import Split
from gtlayout.results.layout_files import write_results
from gtlayout.review.review import review
from gtlayout.session.session import Session
from gtlayout.solution import Solution
from gtlayout.synth import SynthConfig, synthesize


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("curved") / "bay"
    synthesize(folder, SynthConfig(room="bay", frames=20, key_every=6, width=320, height=240, seed=1))
    return folder


@pytest.fixture(scope="module")
def session(folder: Path) -> Session:
    scene = load_scene(folder)
    session = Session(scene)
    session.solve(scene.key_frames)
    return session


@pytest.fixture(scope="module")
def solved(session: Session) -> Solved:
    found = session._last
    assert found is not None
    return found


@pytest.fixture(scope="module")
def planes(solved: Solved) -> Estimate:
    return method.solve_planes(solved.prepared, Config())


def wall_of(solution: Solution) -> int:
    (index,) = solution.layout.curved
    return index


def true_cylinder(folder: Path) -> dict[str, Any]:
    planes = json.loads((folder / "gt_planes.json").read_text())["planes"]
    (found,) = [plane["cylinder"] for plane in planes.values() if "cylinder" in plane]
    return dict(found)


def test_the_bay_is_found_with_its_radius(folder: Path, solved: Solved) -> None:
    solution, true = solved.solution, true_cylinder(folder)
    index = wall_of(solution)
    cylinder = solution.layout.curved[index]
    assert cylinder.radius == pytest.approx(true["radius"], rel=0.03)
    assert abs(cylinder.radius - true["radius"]) < 3 * cylinder.sigma_radius
    across = (np.array(true["axis_point"]) - cylinder.axis_point_world)[:2]
    assert np.linalg.norm(across) < 0.05
    assert solution.quality.iou > 0.95
    assert solution.quality.instances[index].verdict == "ok"
    assert solution.quality.instances[index].sigma_normal_deg == cylinder.sigma_normal_deg
    # All that is drawn of it is one instance.
    elements = json.loads((folder / "gt_planes.json").read_text())["elements"]
    names = {
        elements[solution.scene.frame_of(k).name][solution.scene.key_frames[k].elements[e].id]
        for k, e in solution.instances[index].members
    }
    assert len(names) == 1
    members = sum(names & {name} == {name} for frame in elements.values() for name in frame.values())
    assert members == len(solution.instances[index].members)


def test_nobody_asks_whether_a_curved_wall_is_flat(solved: Solved) -> None:
    instances, flatness = solved.solution.instances, solved.solution.layout.flatness
    asked = {i for i, one in enumerate(flatness) if one is not None}
    assert asked == {i for i, one in enumerate(instances) if one.host is None} - {wall_of(solved.solution)}


def test_what_meets_a_curved_wall_says_nothing_of_planes(solved: Solved) -> None:
    prepared, index = solved.prepared, wall_of(solved.solution)
    assert [wall.instance for wall in prepared.curved] == [index]
    assert any(index in edge.instances for edge in prepared.edges)
    assert not any(index in edge.instances for edge in prepared.flat.edges)
    assert len(prepared.flat.edges) == sum(index not in edge.instances for edge in prepared.edges)
    flat = replace(prepared, curved=())
    assert flat.flat is flat
    assert not any(index in pair for pair in solved.solution.estimate.contact_offsets)


def test_only_some_are_looked_at(solved: Solved, planes: Estimate) -> None:
    prepared, config = solved.prepared, Config()
    index = wall_of(solved.solution)
    others = {i for i, one in enumerate(prepared.instances) if one.label == "wall"} - {index}
    assert find_curved(prepared, planes.planes, config.edges, config.curved, others) == ()
    assert [one.instance for one in find_curved(prepared, planes.planes, config.edges, config.curved, {index})] == [
        index
    ]


def test_who_drew_it_may_say_so(solved: Solved, planes: Estimate) -> None:
    prepared, index = solved.prepared, wall_of(solved.solution)
    assert drawn_curved(prepared.scene, prepared.instances) == set()
    k, e = prepared.instances[index].members[0]
    key_frames = list(prepared.scene.key_frames)
    elements = list(key_frames[k].elements)
    elements[e] = replace(elements[e], curved=True)
    key_frames[k] = replace(key_frames[k], elements=tuple(elements))
    said = replace(prepared, scene=replace(prepared.scene, key_frames=tuple(key_frames)))
    assert drawn_curved(said.scene, said.instances) == {index}
    strict = replace(Config().curved, min_gain=1e9)
    assert find_curved(prepared, planes.planes, Config().edges, strict) == ()
    assert [one.instance for one in find_curved(said, planes.planes, Config().edges, strict)] == [index]


@pytest.mark.parametrize("curved", [True, False])
def test_a_curved_wall_is_not_split(
    curved: bool, solved: Solved, planes: Estimate, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared, index = solved.prepared, wall_of(solved.solution)
    members = prepared.instances[index].members
    monkeypatch.setattr(regrouping, "find_splits", lambda *_: (Split(index, (members[:2], members[2:])),))
    monkeypatch.setattr(regrouping, "find_joins", lambda *_: ())
    found = regroup(prepared, planes, Config().regrouping, Config().extent, lambda i: curved and i == index)
    assert (found is None) == curved
    if found is not None:
        assert "are two planes by their tracks: split" in found.messages[0]


@pytest.mark.parametrize("curved", [True, False])
def test_a_curved_wall_is_not_left_out(
    curved: bool, solved: Solved, planes: Estimate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a plane predicts of it is wrong, and not what is drawn."""
    prepared, index = solved.prepared, wall_of(solved.solution)
    monkeypatch.setattr(regrouping, "find_contradictions", lambda *_: (prepared.instances[index].members[:1],))
    found = regroup(prepared, planes, Config().regrouping, Config().extent, lambda i: curved and i == index)
    assert (found is None or not found.left_out) == curved


def test_a_solve_asks_whether_a_wall_is_curved_before_it_splits_it(
    solved: Solved, planes: Estimate, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared, index = replace(solved.prepared, curved=()), wall_of(solved.solution)
    members = prepared.instances[index].members
    monkeypatch.setattr(regrouping, "find_splits", lambda *_: (Split(index, (members[:2], members[2:])),))
    monkeypatch.setattr(method, "solve_planes", lambda *_: planes)
    again, _ = regrouped(prepared, Config(), Stages())
    assert [one.members for one in again.instances] == [one.members for one in prepared.instances]
    assert [wall.instance for wall in again.curved] == [index]


def test_quick_solves_keep_it(session: Session, solved: Solved) -> None:
    quick = session.quick(solved.solution.scene.key_frames)
    assert list(quick.layout.curved) == [wall_of(solved.solution)]
    before = solved.solution.layout.curved[wall_of(solved.solution)]
    np.testing.assert_allclose(quick.layout.curved[wall_of(solved.solution)].values, before.values, atol=1e-9)
    assert quick.quality.iou == pytest.approx(solved.solution.quality.iou, abs=0.01)


def test_a_measurement_scales_it(solved: Solved) -> None:
    """In a scene without a unit, one of 2 m for each unit."""
    layout = solved.solution.layout
    index = wall_of(solved.solution)
    height = next(one for one in layout.dimensions if one.kind == "height")
    names = (layout.instances[height.first].name, layout.instances[height.second].name)
    tape = Measurement("between", names, 2 * height.length, 0.001)
    scene = replace(solved.solution.scene, metric=False, measurements=(tape,))
    measured = with_measurements(replace(solved.solution, scene=scene))
    assert measured.layout.curved[index].radius == pytest.approx(2 * layout.curved[index].radius, rel=1e-3)
    assert measured.layout.extents[index].region.area == pytest.approx(4 * layout.extents[index].region.area, rel=0.01)
    assert measured.quality.instances[index].iou == pytest.approx(
        solved.solution.quality.instances[index].iou, abs=0.01
    )


def test_a_review_says_nothing_of_where_its_plane_would_be(solved: Solved) -> None:
    index = wall_of(solved.solution)
    own = {(k, solved.solution.scene.key_frames[k].elements[e].id) for k, e in solved.solution.instances[index].members}
    assert not [one for one in review(solved.solution) if (one.key_frame, one.element_id) in own]


def test_where_nothing_is_curved_the_bytes_are_the_same(
    solved: Solved, planes: Estimate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if nobody had looked."""
    prepared, flat = replace(solved.prepared, curved=()), replace(Config().curved, min_gain=1e9)
    monkeypatch.setattr(method, "solve_planes", lambda *_: planes)
    monkeypatch.setattr(method, "regroup", lambda *_: None)
    for folder in ("looked", "not"):
        if folder == "not":
            monkeypatch.setattr(method, "find_curved", lambda *_: ())
        config = replace(Config(), curved=flat)
        solution = lay_out(*regrouped(prepared, config, Stages()), config)
        assert solution.layout.curved == {}
        write_results(tmp_path / folder, solution.scene, solution.layout, solution.quality, config)
    for path in sorted((tmp_path / "not").iterdir()):
        assert path.read_bytes() == (tmp_path / "looked" / path.name).read_bytes(), path.name
