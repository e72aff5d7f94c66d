"""Errors of annotators and cameras: as large as asked for, correlated as said, and never more than that."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation
from shapely import MultiPolygon, Polygon

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.raster import rings_of
from gtlayout.scene import OPENINGS, Camera, Element, FloatArray, KeyFrame, Label
from gtlayout.synth import SynthConfig, shoot
from gtlayout.synth.annotate import annotate
from gtlayout.synth.errors import CONFUSED, AnnotatorErrors, CameraErrors, disturb, disturb_cameras
from gtlayout.synth.motion import looking
from gtlayout.synth.render import cast
from gtlayout.synth.room import ROOM_KINDS, RoomKind, make_room

WIDTH, HEIGHT = 640, 480
CAMERA = Camera(np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.eye(3), np.zeros(3), WIDTH, HEIGHT)
PERFECT = AnnotatorErrors(corner_sigma_px=0)
Segment = tuple[list[float], list[float]]
TOP, BOTTOM, FLOOR_LEFT, FLOOR_RIGHT = [320.0, 110], [320.0, 330], [0.0, 420], [640.0, 380]


def _element(number: int, label: Label, *corners: list[float]) -> Element:
    visible = Polygon(corners).buffer(-15)
    return Element(f"e{number}", label, MultiPolygon([Polygon(corners)]), MultiPolygon([visible]))


@pytest.fixture
def corner_of_a_room() -> KeyFrame:
    """Two walls that meet at x = 320, floor and ceiling; a door on the right wall that stands on the floor."""
    door_left, door_right = ([x, 330 + (x - 320) * 50 / 320] for x in (420.0, 500.0))
    return KeyFrame(
        0,
        (
            _element(0, "wall", [0, 40], TOP, BOTTOM, FLOOR_LEFT),
            _element(1, "wall", TOP, [640, 60], FLOOR_RIGHT, door_right, door_left, BOTTOM),
            _element(2, "floor", FLOOR_LEFT, BOTTOM, FLOOR_RIGHT, [640, 480], [0, 480]),
            _element(3, "ceiling", [0, 0], [640, 0], [640, 60], TOP, [0, 40]),
            _element(4, "door", [420, 180], [500, 185], door_right, door_left),
        ),
        (np.array([TOP, BOTTOM]),),
    )


def _draws(key_frame: KeyFrame, errors: AnnotatorErrors, count: int = 250) -> Iterator[KeyFrame]:
    for seed in range(count):
        yield disturb(key_frame, CAMERA, errors, np.random.default_rng(seed))


def _ring(element: Element) -> FloatArray:
    (ring,) = rings_of(element.amodal)
    return ring


def _off(points: FloatArray, start: list[float], end: list[float]) -> FloatArray:
    """Signed distances of (N, 2) points to a line."""
    along = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    moved: FloatArray = (points - start) @ np.array([-along[1], along[0]])
    return moved


def _near(ring: FloatArray, corner: list[float]) -> FloatArray:
    """(1, 2) the ring's corner nearest to what was drawn without errors."""
    return ring[[np.argmin(np.linalg.norm(ring - corner, axis=1))]]


def _same(a: MultiPolygon, b: MultiPolygon) -> bool:
    return bool(a.symmetric_difference(b).area < 1e-9)


def test_a_perfect_annotator_changes_nothing(corner_of_a_room: KeyFrame) -> None:
    drawn = disturb(corner_of_a_room, CAMERA, PERFECT, np.random.default_rng(0))
    for before, after in zip(corner_of_a_room.elements, drawn.elements, strict=True):
        assert (after.id, after.label) == (before.id, before.label)
        assert _same(after.amodal, before.amodal)
        assert _same(after.visible, before.visible)
    np.testing.assert_array_equal(drawn.occlusion_edges, corner_of_a_room.occlusion_edges)


def test_an_edge_is_off_as_a_whole_and_for_both_its_neighbours(corner_of_a_room: KeyFrame) -> None:
    edges: dict[str, tuple[list[float], list[float], dict[int, Segment]]] = {
        # start, end, and which elements run along it between which of their corners
        "wall/wall": (TOP, BOTTOM, {0: (TOP, BOTTOM), 1: (TOP, BOTTOM)}),
        "floor/left wall": (FLOOR_LEFT, BOTTOM, {0: (BOTTOM, FLOOR_LEFT), 2: (FLOOR_LEFT, BOTTOM)}),
        "floor/right wall": (BOTTOM, FLOOR_RIGHT, {1: (FLOOR_RIGHT, BOTTOM), 2: (BOTTOM, FLOOR_RIGHT)}),
        "door/its top": ([420, 180], [500, 185], {4: ([420, 180], [500, 185])}),
    }
    offsets: dict[str, list[float]] = {name: [] for name in edges}
    for drawn in _draws(corner_of_a_room, replace(PERFECT, edge_sigma_px=3.0)):
        for name, (start, end, sides) in edges.items():
            off = [
                _off(_near(_ring(drawn.elements[number]), corner), start, end)[0]
                for number, corners in sides.items()
                for corner in corners
            ]
            np.testing.assert_allclose(off, off[0], atol=1e-6)
            offsets[name].append(off[0])
        # The door stands on the same floor: its threshold moves with the wall's lower edge though it is shorter.
        door = _ring(drawn.elements[4])
        threshold = np.concatenate([_near(door, [420, 346]), _near(door, [500, 358])])
        np.testing.assert_allclose(_off(threshold, BOTTOM, FLOOR_RIGHT), offsets["floor/right wall"][-1], atol=1e-6)
        (occlusion,) = drawn.occlusion_edges
        np.testing.assert_allclose(_off(occlusion, TOP, BOTTOM), offsets["wall/wall"][-1], atol=1e-6)
    for off_px in offsets.values():
        assert np.std(off_px) == pytest.approx(3.0, rel=0.1)
        assert np.mean(off_px) == pytest.approx(0.0, abs=0.5)
    correlation = np.corrcoef(list(offsets.values()))
    np.testing.assert_allclose(correlation, np.eye(len(offsets)), atol=0.15)


def test_an_edge_from_border_to_border_is_off_too_and_the_border_is_not() -> None:
    left, right = [0.0, 300.0], [640.0, 300.0]
    wall = _element(0, "wall", [0, 0], [640, 0], right, left)
    floor = _element(1, "floor", left, right, [640, 480], [0, 480])
    offsets = []
    for drawn in _draws(KeyFrame(0, (wall, floor)), replace(PERFECT, edge_sigma_px=3.0)):
        above, below = (each.amodal.bounds for each in drawn.elements)
        assert above[:3] == (0, 0, 640)
        assert below[2:] == (640, 480)
        assert below[0] == 0
        assert below[1] == pytest.approx(above[3])
        offsets.append(above[3] - 300)
    assert np.std(offsets) == pytest.approx(3.0, rel=0.1)


def test_elements_share_the_hands_error_at_common_corners(corner_of_a_room: KeyFrame) -> None:
    shifts = []
    for drawn in _draws(corner_of_a_room, AnnotatorErrors(corner_sigma_px=2.0)):
        at_bottom = [_near(_ring(drawn.elements[number]), BOTTOM)[0] for number in (0, 1, 2)]
        np.testing.assert_allclose(at_bottom, at_bottom[:1] * 3, atol=1e-9)
        np.testing.assert_allclose(drawn.occlusion_edges[0][1], at_bottom[0], atol=1e-9)
        shifts += [at_bottom[0] - BOTTOM, _near(_ring(drawn.elements[4]), [420, 180])[0] - [420, 180]]
        # Where an edge leaves the image the hand slides along the border.
        assert _near(_ring(drawn.elements[0]), FLOOR_LEFT)[0, 0] == 0
    assert np.std(shifts) == pytest.approx(2.0, rel=0.06)


def test_shares_are_as_asked_for(corner_of_a_room: KeyFrame) -> None:
    errors = AnnotatorErrors(
        missing_share=0.2, swapped_share=0.3, missing_occlusion_share=0.4, no_visible_share=0.1, corner_sigma_px=0
    )
    truth = {element.id: element.label for element in corner_of_a_room.elements}
    drawn = [element for each in _draws(corner_of_a_room, errors) for element in each.elements]
    asked = 250 * len(truth)
    assert len(drawn) / asked == pytest.approx(0.8, abs=0.03)
    swapped = [element for element in drawn if element.label != truth[element.id]]
    assert len(swapped) / len(drawn) == pytest.approx(0.3, abs=0.03)
    assert {(truth[e.id], e.label) for e in swapped} == {(a, b) for a in {*truth.values()} for b in CONFUSED[a]}
    assert np.mean([element.visible.is_empty for element in drawn]) == pytest.approx(0.1, abs=0.03)
    lines = [len(each.occlusion_edges) for each in _draws(corner_of_a_room, errors)]
    assert np.mean(lines) == pytest.approx(0.6, abs=0.07)
    everything = AnnotatorErrors(missing_share=1, missing_occlusion_share=1)
    nothing = disturb(corner_of_a_room, CAMERA, everything, np.random.default_rng(0))
    assert nothing == KeyFrame(0, (), ())


def test_one_kind_of_error_does_not_change_the_others(corner_of_a_room: KeyFrame) -> None:
    """So that an evaluation can vary one at a time."""
    shaky = AnnotatorErrors(corner_sigma_px=2, edge_sigma_px=2)
    some = replace(shaky, missing_share=0.3, swapped_share=0.5)
    more = replace(some, missing_share=0.5)
    draws = [_draws(corner_of_a_room, errors, 20) for errors in (shaky, some, more)]
    for of_shaky, of_some, of_more in zip(*draws, strict=True):
        drawn = {element.id: element for element in of_shaky.elements}
        for element in of_some.elements:
            assert _same(element.amodal, drawn[element.id].amodal)
        assert {element.id for element in of_more.elements} <= {element.id for element in of_some.elements}


@pytest.mark.parametrize("kind", ROOM_KINDS)
def test_polygons_stay_valid_and_in_the_image_however_bad_the_hand(kind: RoomKind) -> None:
    room = make_room(2, kind)
    config = SynthConfig(seed=2, room=kind, width=320, height=240)
    image = shapely.box(0, 0, config.width, config.height)
    for number, camera in enumerate(shoot(room, config).cameras[::20]):
        exact, _ = annotate(room, camera, cast(room.surfaces, camera), number, np.random.default_rng(0))
        for sigma_px in (1.0, 5.0, 25.0):
            errors = AnnotatorErrors(corner_sigma_px=sigma_px, edge_sigma_px=sigma_px)
            drawn = disturb(exact, camera, errors, np.random.default_rng(number))
            assert [element.id for element in drawn.elements] == [element.id for element in exact.elements]
            for before, after in zip(exact.elements, drawn.elements, strict=True):
                assert after.amodal.is_valid
                assert not after.amodal.is_empty
                assert image.covers(after.amodal)
                if sigma_px == 1.0 and after.label not in OPENINGS:
                    assert after.amodal.intersection(before.amodal).area > 0.5 * before.amodal.area
            assert all(image.covers(shapely.LineString(line)) for line in drawn.occlusion_edges)


def test_neighbours_in_a_room_keep_running_along_each_other() -> None:
    """Contact edges are found by it: neighbours displaced with their common edge leave gaps at corners only."""
    room = make_room(2)
    camera = shoot(room, SynthConfig(seed=2, width=320, height=240)).cameras[5]
    exact, _ = annotate(room, camera, cast(room.surfaces, camera), 0, np.random.default_rng(0))
    image_px2 = 320 * 240
    for seed in range(20):
        drawn = disturb(exact, camera, AnnotatorErrors(0, edge_sigma_px=4), np.random.default_rng(seed))
        covered = shapely.union_all([element.amodal for element in drawn.elements]).area
        overlap = sum(e.amodal.area for e in drawn.elements if e.label not in OPENINGS) - covered
        assert covered / image_px2 > 0.995
        assert overlap / image_px2 < 0.005


@pytest.mark.parametrize(
    ("errors", "message"),
    [
        ({"corner_sigma_px": -1.0}, "corner_sigma_px must not be negative"),
        ({"edge_sigma_px": float("nan")}, "edge_sigma_px must not be negative"),
        ({"missing_share": 1.1}, "missing_share must be at most 1"),
    ],
)
def test_impossible_errors_of_annotators_are_refused(errors: dict[str, Any], message: str) -> None:
    with pytest.raises(GtlayoutError, match=message):
        AnnotatorErrors(**errors)


def test_impossible_errors_of_cameras_are_refused() -> None:
    with pytest.raises(GtlayoutError, match="rotation_sigma_deg must not be negative"):
        CameraErrors(rotation_sigma_deg=-1)


def _cameras(frames: int) -> tuple[Camera, ...]:
    return tuple(
        replace(CAMERA, R_cam_from_world=looking(0.02 * n, 0, 0), t_cam_from_world=looking(0.02 * n, 0, 0) @ [n, 0, 1])
        for n in range(frames)
    )


def test_camera_errors_are_as_large_as_asked_for_and_mostly_slow() -> None:
    true = _cameras(40)
    errors = CameraErrors(rotation_sigma_deg=0.5, position_sigma_m=0.03, focal_sigma_share=0.01)
    turns, shifts, focals = [], [], []
    for seed in range(200):
        written = disturb_cameras(true, errors, np.random.default_rng(seed))
        pairs = list(zip(true, written, strict=True))
        turns.append([Rotation.from_matrix(w.R_cam_from_world @ t.R_cam_from_world.T).as_rotvec() for t, w in pairs])
        shifts.append([w.center_world - t.center_world for t, w in pairs])
        shares = {w.K[0, 0] / t.K[0, 0] for t, w in pairs} | {w.K[1, 1] / t.K[1, 1] for t, w in pairs}
        assert max(shares) - min(shares) < 1e-12, "one lens"
        focals.append(min(shares))
        assert all(np.array_equal(w.K[:2, 2], t.K[:2, 2]) for t, w in pairs)
        R = written[7].R_cam_from_world
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.rad2deg(np.std(turns)) == pytest.approx(0.5, rel=0.05)
    assert np.std(shifts) == pytest.approx(0.03, rel=0.05)
    assert np.std(focals) == pytest.approx(0.01, rel=0.15)
    for noise, sigma in ((np.array(shifts), 0.03), (np.rad2deg(turns), 0.5)):
        np.testing.assert_allclose(noise.std(axis=(0, 2)), sigma, rtol=0.15)  # at every frame
        assert np.diff(noise, axis=1).std() < 0.7 * sigma, "white noise has √2"


def test_without_errors_cameras_are_written_as_they_are() -> None:
    true = _cameras(5)
    for before, after in zip(true, disturb_cameras(true, CameraErrors(), np.random.default_rng(0)), strict=True):
        np.testing.assert_allclose(after.K, before.K, atol=1e-12)
        np.testing.assert_allclose(after.R_cam_from_world, before.R_cam_from_world, atol=1e-12)
        np.testing.assert_allclose(after.t_cam_from_world, before.t_cam_from_world, atol=1e-12)
