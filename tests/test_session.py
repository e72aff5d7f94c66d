"""A scene while it is annotated: what is kept changes nothing, and quick solves are near full ones."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.depth import depth_at_centroid
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve
from gtlayout.prepared.canonical import canonical, redrawn
from gtlayout.scene import Element, FloatArray, KeyFrame, Scene
from gtlayout.session.session import Session
from gtlayout.solution import Solution
from gtlayout.synth import SynthConfig, synthesize

FULL, QUICK = "cameras", "extents"
"""Stages that only a full solve has, and that both have."""


def copied(session: Session) -> Session:
    """Another session that knows the same."""
    other = Session(session._scene, session._config)
    other._memory, other._last = deepcopy(session._memory), session._last
    return other


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("session") / "room"
    synthesize(folder, SynthConfig(frames=12, key_every=4, width=160, height=120, oversample=1))
    return load_scene(folder)


@pytest.fixture(scope="module")
def solved(scene: Scene) -> tuple[Session, Solution, Session, Solution]:
    """A session with all key frames but the last, and its solution; then the same with all of them."""
    session = Session(scene)
    with pytest.raises(GtlayoutError, match="no element is annotated"):
        session.solve([])
    # There is nothing to go on from.
    part = session.quick(scene.key_frames[:-1])
    assert FULL in part.timings_s
    before = copied(session)
    return before, part, session, session.solve(scene.key_frames)


@pytest.fixture
def session(solved: tuple[Session, Solution, Session, Solution]) -> Session:
    """With all key frames solved in full."""
    return copied(solved[2])


@pytest.fixture
def full(solved: tuple[Session, Solution, Session, Solution]) -> Solution:
    """The solution of all key frames."""
    return solved[3]


def bytes_of(solution: Solution) -> list[bytes]:
    layout = solution.layout
    return [
        np.array([[*plane.normal, plane.d] for plane in layout.planes]).tobytes(),
        solution.estimate.covariance.tobytes(),
        solution.tracks.points_px.tobytes(),
        shapely.to_wkb(MultiPolygon([part for one in layout.extents for part in one.region.geoms])),
        repr([(one.name, one.members, one.host) for one in layout.instances]).encode(),
        repr((solution.quality.iou, solution.scene.warnings)).encode(),
    ]


def with_element(key_frames: Sequence[KeyFrame], k: int, e: int, element: Element | None) -> tuple[KeyFrame, ...]:
    """One element changed, or removed."""
    elements = list(key_frames[k].elements)
    elements[e : e + 1] = [] if element is None else [element]
    changed = list(key_frames)
    changed[k] = replace(changed[k], elements=tuple(elements))
    return tuple(changed)


def with_moved_corner(scene: Scene, k: int, step_px: FloatArray) -> tuple[KeyFrame, ...]:
    """One corner of key frame ``k``, the first that is not on the border of the image, moved in all its outlines."""
    key_frame, camera = scene.key_frames[k], scene.frame_of(k).camera
    points = np.concatenate([shapely.get_coordinates(element.amodal) for element in key_frame.elements])
    size = np.array([camera.width, camera.height])
    corner = points[((points > 5) & (points < size - 5)).all(axis=1)][0]

    def moved(px: FloatArray) -> FloatArray:
        return px + (np.linalg.norm(px - corner, axis=1) < 3)[:, None] * step_px

    elements = [replace(one, amodal=shapely.transform(one.amodal, moved)) for one in key_frame.elements]
    changed = list(scene.key_frames)
    changed[k] = replace(key_frame, elements=tuple(elements))
    return tuple(changed)


def depth_differences(quick: Solution, full: Solution) -> FloatArray:
    """Of planes of the same elements, at the centroid of the largest; as shares."""
    index = {instance.members: i for i, instance in enumerate(full.instances)}
    assert {instance.members for instance in quick.instances} == set(index)
    pairs = [(i, index[one.members], one) for i, one in enumerate(quick.instances)]
    depths = [
        (depth_at_centroid(quick.scene, one, quick.planes[i])[1], depth_at_centroid(full.scene, one, full.planes[j])[1])
        for i, j, one in pairs
    ]
    return np.array([abs(a / b - 1) for a, b in depths])


def test_a_full_solve_gives_the_same_bytes_whatever_was_solved_before(scene: Scene, session: Session) -> None:
    moved = with_moved_corner(scene, 1, np.array([8.0, 5.0]))
    # The order in which they are given does not matter.
    assert bytes_of(session.solve(moved[::-1])) == bytes_of(solve(replace(scene, key_frames=moved)))


def test_nothing_is_looked_at_twice(scene: Scene, session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def read(frame: object) -> None:
        asked.append(frame)
        raise AssertionError("an image is read")

    monkeypatch.setattr("gtlayout.tracking.image_cache.read_gray", read)
    monkeypatch.setattr("gtlayout.tracking.features.read_gray", read)
    session.solve(with_moved_corner(scene, 1, np.array([8.0, 5.0])))
    session.quick(with_moved_corner(scene, 1, np.array([4.0, 5.0])))
    assert not asked


def test_without_a_change_everything_stays(scene: Scene, session: Session, full: Solution) -> None:
    before = session._last
    after = session.quick(scene.key_frames)
    assert FULL not in after.timings_s
    assert QUICK in after.timings_s
    assert before is not None
    assert all(a is b for a, b in zip(after.layout.extents, before.solution.layout.extents, strict=True))
    assert after.instances == full.instances
    for a, b in zip(after.planes, full.planes, strict=True):
        np.testing.assert_allclose([*a.normal, a.d], [*b.normal, b.d], atol=1e-12)
        assert a.sigma_depth_m == pytest.approx(b.sigma_depth_m, rel=0.05)
    assert after.quality.iou == pytest.approx(full.quality.iou, abs=0.02)


def test_a_moved_corner_is_solved_as_in_full(scene: Scene, session: Session, full: Solution) -> None:
    moved = with_moved_corner(scene, 1, np.array([9.0, 6.0]))
    quick, found = session.quick(moved), copied(session).solve(moved)
    assert FULL not in quick.timings_s
    assert depth_differences(quick, found).max() < 0.005
    ratio = [a.sigma_depth_m / b.sigma_depth_m for a, b in zip(quick.planes, found.planes, strict=True)]
    assert min(ratio) > 0.9
    quick_area, area, before = (
        np.array([one.region.area for one in solution.layout.extents]) for solution in (quick, found, full)
    )
    np.testing.assert_allclose(quick_area, area, rtol=0.02)
    # … which the drawing before had otherwise.
    assert np.abs(quick_area / before - 1).max() > 0.001


def test_one_sequence_of_changes_gives_one_result(
    scene: Scene, solved: tuple[Session, Solution, Session, Solution]
) -> None:
    results = []
    for session in (copied(solved[0]), copied(solved[0])):
        session.quick(scene.key_frames)
        results.append(bytes_of(session.quick(with_moved_corner(scene, 0, np.array([-6.0, 3.0])))))
    assert results[0] == results[1]


def test_a_new_key_frame_joins_the_instances(
    scene: Scene, solved: tuple[Session, Solution, Session, Solution], full: Solution
) -> None:
    found = copied(solved[0]).quick(scene.key_frames)
    assert FULL not in found.timings_s
    assert depth_differences(found, full).max() < 0.03
    last = len(scene.key_frames) - 1
    assert np.count_nonzero(found.tracks.key_frame == last) > 20
    assert (np.diff(found.tracks.key_frame) >= 0).all()
    assert found.tracks.tried[last].sum() >= np.count_nonzero(found.tracks.key_frame == last)


def test_a_key_frame_that_is_removed_is_gone(
    scene: Scene, session: Session, solved: tuple[Session, Solution, Session, Solution]
) -> None:
    found = session.quick(scene.key_frames[:-1])
    assert FULL not in found.timings_s
    assert depth_differences(found, solved[1]).max() < 0.03


def test_an_element_that_is_removed_or_labelled_otherwise(scene: Scene, session: Session, full: Solution) -> None:
    wall = next(i for i, one in enumerate(full.instances) if one.label == "wall" and len(one.members) > 1)
    k, e = full.instances[wall].members[0]
    gone = copied(session).quick(with_element(scene.key_frames, k, e, None))
    assert sum(len(one.members) for one in gone.instances) == sum(len(one.members) for one in full.instances) - 1
    other = replace(scene.key_frames[k].elements[e], label="slanted")
    found = session.quick(with_element(scene.key_frames, k, e, other))
    assert next(one for one in found.instances if one.label == "slanted").members == ((k, e),)


def test_points_beside_what_is_visible_now_are_dropped(scene: Scene, session: Session, full: Solution) -> None:
    before = full
    k, e = 1, int(np.argmax(before.tracks.per_element()[1]))
    element = scene.key_frames[k].elements[e]
    left, top, right, bottom = element.visible.bounds
    less = element.visible.intersection(shapely.box(left, top, left + 0.8 * (right - left), bottom))
    smaller = replace(element, visible=MultiPolygon([less]) if less.geom_type == "Polygon" else less)
    found = session.quick(with_element(scene.key_frames, k, e, smaller))
    mine = (found.tracks.key_frame == k) & (found.tracks.element == e)
    first = np.searchsorted(found.tracks.track, np.nonzero(mine)[0])
    assert 0 < np.count_nonzero(mine) < before.tracks.per_element()[k][e]
    at_key = found.tracks.frame == scene.key_frames[k].frame
    start = found.tracks.points_px[at_key & mine[found.tracks.track]]
    assert len(start) == len(first)
    assert shapely.contains_xy(less.buffer(1e-9), start).all()
    assert found.tracks.tried[k][e] < before.tracks.tried[k][e]


def test_a_frame_that_the_last_solve_left_out_is_solved_in_full(scene: Scene) -> None:
    """A frame with the camera of the one before says nothing new, and is left out of a solve."""
    frames = list(scene.frames)
    same = scene.key_frames[0].frame + 1
    frames[same] = replace(frames[same], camera=frames[same - 1].camera)
    form = canonical(replace(scene, frames=tuple(frames)))
    again = replace(scene.key_frames[0], frame=same)
    assert redrawn(form, replace(form.given, key_frames=(*scene.key_frames, again))) is None
    assert redrawn(form, form.given) is not None


def test_a_drawing_without_elements_is_an_error_after_which_the_session_goes_on(scene: Scene, session: Session) -> None:
    with pytest.raises(GtlayoutError, match="no element is annotated"):
        session.quick([replace(one, elements=()) for one in scene.key_frames])
    assert FULL not in session.quick(scene.key_frames).timings_s
