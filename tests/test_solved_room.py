"""Corners that move with their planes, areas, volumes and openings: closed forms in the box room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import rooms
import shapely
from scipy.linalg import block_diag

from gtlayout.accuracy import SIGMAS_95, accuracy_of, level_of
from gtlayout.dimensions.areas import quantities
from gtlayout.dimensions.drawing_noise import USUAL_SIGMA_PX
from gtlayout.dimensions.openings import opening_dimensions
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.dimensions.take import all_dimensions, by_neighbours, surface_accuracy, take_dimensions
from gtlayout.instances import NextMeasurement, Plane, Support
from gtlayout.measured.fuse import as_measured
from gtlayout.measurement import GROSS_M, NAMED, TAPE_SIGMA_M, Checked, Measurement
from gtlayout.scene import FloatArray, KeyFrame

CAMERA = rooms.level_camera([2.0, 1.0, 1.25], focal=400.0, width=640, height=480)
DOOR = rooms.Surface("door", rooms.rectangle([1.5, rooms.DEPTH_M, 0.0], [0.9, 0, 0], [0, 0, 2.0]), host=4)
WINDOW = rooms.Surface("window", rooms.rectangle([1.6, rooms.DEPTH_M, 0.9], [1.2, 0, 0], [0, 0, 1.0]), host=4)


def room_of(surfaces: Sequence[rooms.Surface], sigma: float = 0.0) -> SolvedRoom:
    covariance = np.diag([0.0, 0.0, 0.0, sigma**2])
    return SolvedRoom(
        rooms.seen_from([CAMERA], surfaces),
        rooms.instances_of(surfaces, 1),
        [replace(surface.plane, covariance=covariance) for surface in surfaces],
        [surface.extent for surface in surfaces],
    )


def offsets(count: int, sigma: float) -> FloatArray:
    """Joint covariance of planes that are off along their normals, each by itself."""
    return np.asarray(block_diag(*[np.diag([0.0, 0.0, 0.0, sigma**2])] * count))


def test_a_corner_of_three_planes_moves_as_their_intersection() -> None:
    """Against central differences of the point in which floor, left and far wall meet, tilted and moved."""
    room = room_of(rooms.BOX)
    corner = np.array([[0.0, rooms.DEPTH_M, 0.0]])
    others = room.on_others(0, corner)
    assert sorted(others[0]) == [2, 4], "the left and the far wall"
    motion = room.motion(0, corner, others)[0]

    def at(coefficients: FloatArray) -> FloatArray:
        used = coefficients.reshape(-1, 4)[[0, 2, 4]]
        return np.asarray(np.linalg.solve(used[:, :3], -used[:, 3]))

    planes = np.concatenate([[*plane.normal, plane.d] for plane in room.planes])
    step = 1e-6
    expected = np.stack([(at(planes + step * e) - at(planes - step * e)) / (2 * step) for e in np.eye(len(planes))], 1)
    np.testing.assert_allclose(motion, expected, atol=1e-8)


def test_a_point_on_an_edge_moves_no_more_than_it_must_and_a_free_one_along_its_ray() -> None:
    room = room_of(rooms.BOX)
    edge, free = np.array([[0.0, 3.0, 0.0]]), np.array([[2.0, 3.0, 0.0]])
    (on_edge,) = room.motion(0, edge, room.on_others(0, edge))
    np.testing.assert_allclose(on_edge @ np.eye(24)[3], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(on_edge @ np.eye(24)[11], [-1, 0, 0], atol=1e-12)
    assert room.on_others(0, free) == [[]]
    (of_free,) = room.motion(0, free, [[]])
    ray = free[0] - CAMERA.center_world
    np.testing.assert_allclose(of_free @ np.eye(24)[3], -ray / ray[2], atol=1e-12)


def test_areas_and_volume_of_the_box_room() -> None:
    """σ of a product of two lengths, each the difference of two walls that are .01 off by themselves."""
    room = room_of(rooms.BOX)
    heights = [one for one in all_dimensions(room) if one[0].kind == "height"]
    found = {(one.kind, one.instances): (one, measured) for one, measured in quantities(room, heights)}
    covariance = offsets(6, 0.01)
    length = 0.01 * np.sqrt(2)

    def check(key: tuple[str, tuple[int, ...]], amount: float, sigma: float) -> None:
        one, measured = found[key]  # type: ignore[index]
        assert one.amount == pytest.approx(amount)
        assert one.closed
        assert measured.sigma(covariance) == pytest.approx(sigma)

    width, depth, height = rooms.WIDTH_M, rooms.DEPTH_M, rooms.HEIGHT_M
    check(("floor area", (0,)), width * depth, length * np.hypot(width, depth))
    check(("net wall area", (4,)), width * height, length * np.hypot(width, height))
    volume = length * np.linalg.norm([width * depth, depth * height, height * width])
    check(("volume", (0, 1)), width * depth * height, volume)
    total, _ = found["net wall area", (2, 3, 4, 5)]
    assert total.amount == pytest.approx(2 * (width + depth) * height)


def test_a_wall_out_of_all_proportion_has_no_area() -> None:
    found = {(one.kind, one.instances): one for one, _ in quantities(room_of(rooms.BOX), [], astray=[3])}
    assert [key for key in found if key[0] == "net wall area"] == [
        ("net wall area", of) for of in ((2,), (4,), (5,), (2, 4, 5))
    ]
    assert not found["net wall area", (2, 4, 5)].closed
    assert found["net wall area", (4,)].closed


def test_openings_are_taken_out_of_their_wall() -> None:
    room = room_of((*rooms.BOX, DOOR))
    found = {one.instances: one for one, _ in quantities(room, []) if one.kind == "net wall area"}
    assert found[4,].amount == pytest.approx(rooms.WIDTH_M * rooms.HEIGHT_M - 0.9 * 2.0)
    assert found[2,].amount == pytest.approx(rooms.DEPTH_M * rooms.HEIGHT_M)


def test_a_floor_that_ends_where_nobody_looked_is_not_closed_and_as_uncertain_as_drawn() -> None:
    """Without the near wall the floor's edge is drawn: it moves as a whole by the σ of a drawn edge."""
    surfaces = rooms.BOX[:5]
    room = room_of(surfaces)
    (floor,) = [one for one in quantities(room, []) if one[0].kind == "floor area"]
    assert not floor[0].closed
    middle = np.array([2.0, 0.0, 0.0])
    camera_behind = replace(room.scene.frames[0], camera=rooms.level_camera([2.0, -3.0, 1.25], 400.0, 640, 480))
    room = replace(room, scene=replace(room.scene, frames=(camera_behind,)))
    (floor,) = [one for one in quantities(room, []) if one[0].kind == "floor area"]
    assert floor[1].drawn_sigma == pytest.approx(
        rooms.WIDTH_M * room.drawn_sigma(0, middle, np.array([0.0, 1.0, 0.0])), rel=1e-5
    )
    # A camera 1.25 m up and 3 m away: a pixel of y is z² / (f h) along the floor.
    assert room.drawn_sigma(0, middle, np.array([0.0, 1.0, 0.0])) == pytest.approx(
        USUAL_SIGMA_PX * 9 / (400 * 1.25), rel=1e-5
    )


def test_a_window_is_measured_with_its_sill() -> None:
    room = room_of((*rooms.BOX, WINDOW))
    found = {one.kind: (one, measured) for one, measured in opening_dimensions(room)}
    assert {kind: one.length for kind, (one, _) in found.items()} == pytest.approx(
        {"opening width": 1.2, "opening height": 1.0, "sill": 0.9}
    )
    sill = found["sill"][0]
    assert (sill.first, sill.second) == (0, 6)
    # 4 m away a pixel is 1 cm; two ends that are drawn apart. The window lies in its wall, so no reveal hides a part.
    assert found["opening width"][1].drawn_sigma == pytest.approx(np.sqrt(2) * USUAL_SIGMA_PX * 0.01)
    # The whole picture of a window that is 1 cm further away is larger: 1.2 m / 4 m.
    gradient = found["opening width"][1].gradient
    assert gradient[4 * 6 + 3] == pytest.approx(1.2 / 4.0)


def test_what_lies_behind_its_wall_is_as_uncertain_as_what_a_reveal_hides() -> None:
    """A window .1 m behind the wall, seen at slopes of ± .15: each end lies within .1 m · .15 of where it was found."""
    back = replace(WINDOW, corners=WINDOW.corners + np.array([0.0, 0.1, 0.0]))
    room = room_of((*rooms.BOX, back))
    found = {one.kind: measured for one, measured in opening_dimensions(room)}
    drawn = USUAL_SIGMA_PX * 4.1 / 400
    left, right = ((2.0 - 1.6) / 4.1, (2.8 - 2.0) / 4.1)
    hidden = [0.1 * slope / np.sqrt(3) for slope in (left, right)]
    assert found["opening width"].drawn_sigma == pytest.approx(np.linalg.norm([drawn, drawn, *hidden]))


def test_slivers_of_a_door_have_no_width() -> None:
    """What a wrong plane leaves of a drawing may be pieces far apart, with nothing where one would hold the tape."""
    room = room_of((*rooms.BOX, DOOR))
    extent = room.extents[6]
    left, low, right, high = extent.region.bounds
    pieces = [shapely.box(left, low, right, low + 0.01), shapely.box(left, high - 0.01, right, high)]
    cut = replace(extent, region=shapely.MultiPolygon(pieces))
    assert opening_dimensions(replace(room, extents=(*room.extents[:6], cut))) == []


def test_openings_that_are_cut_or_hidden_have_no_width() -> None:
    room = room_of((*rooms.BOX, DOOR))
    kinds = {one.kind for one, _ in opening_dimensions(room)}
    assert kinds == {"opening width", "opening height"}
    k = room.scene.key_frames[0]
    ends = np.array([[1.5, rooms.DEPTH_M, z] for z in (0.0, 2.0)])
    edge, _ = CAMERA.project(ends)
    hidden = KeyFrame(k.frame, k.elements, (edge,))
    assert {
        one.kind for one, _ in opening_dimensions(replace(room, scene=replace(room.scene, key_frames=(hidden,))))
    } == {"opening height"}
    near = rooms.level_camera([4.05, 3.5, 1.25], focal=400.0, width=640, height=480)
    cut = replace(room, scene=rooms.seen_from([near], (*rooms.BOX, DOOR)))
    assert "opening width" not in {one.kind for one, _ in opening_dimensions(cut)}, "its left end is beyond the image"


def test_levels_of_accuracy() -> None:
    assert [level_of(error) for error in (0.005, 0.0051, 0.015, 0.05, 0.15, 0.1501, np.nan)] == [
        40,
        30,
        30,
        20,
        10,
        0,
        0,
    ]
    assert accuracy_of(0.02, 20).status == "within"
    assert accuracy_of(0.03, 20).status == "out"
    assert accuracy_of(np.nan, 20).status == "insufficient evidence"
    assert accuracy_of(0.02, 20).error_95_m == pytest.approx(0.0392, abs=1e-4)


def test_the_accuracy_of_a_surface_is_over_its_whole_extent() -> None:
    """A wall 5 m long that turns by σ 1° about its middle is off by |y| times a normal variable.

    Of |N(0, 1)| · U(0, 1) the 95 % quantile is 1.2582, by numeric integration.
    """
    wall = rooms.LEFT
    still = surface_accuracy(replace(wall.plane, covariance=np.diag([0, 0, 0, 0.01**2])), wall.extent, 20)
    assert still.error_95_m == pytest.approx(0.01 * SIGMAS_95, rel=1e-6)
    turn = np.zeros((4, 4))
    gradient = np.array([0.0, 1.0, 0.0, -rooms.DEPTH_M / 2])
    turn += np.deg2rad(1.0) ** 2 * np.outer(gradient, gradient)
    turned = surface_accuracy(replace(wall.plane, covariance=turn), wall.extent, 20)
    assert turned.error_95_m == pytest.approx(1.2582 * np.deg2rad(1.0) * rooms.DEPTH_M / 2, rel=0.01)
    assert surface_accuracy(replace(wall.plane, observable=False), wall.extent, 20).status == "insufficient evidence"


def test_what_to_measure_next_brings_most_to_the_level() -> None:
    """One wall of the width is off by 4 cm: measured, three of three are known."""
    room = room_of(rooms.BOX)
    covariance = offsets(6, 0.001)
    covariance[11, 11] = 0.04**2
    taken = take_dimensions(room, covariance, 20)
    assert [one.accuracy.status for one in taken.dimensions if one.accuracy] == ["within", "out", "within"]
    following = taken.next_measurement
    assert following is not None
    assert taken.dimensions[following.dimension].kind == "width"
    assert (following.within, following.reached, following.of) == (2, 3, 3)
    covariance[11, 11] = TAPE_SIGMA_M**2
    assert take_dimensions(room, covariance, 20).next_measurement is None, "all are known well enough"


def test_what_no_track_shows_is_inferred_until_it_is_measured() -> None:
    """The right wall of the width (3) only touches others; the far one (4) has tracks, too."""
    room = room_of(rooms.BOX)
    touched, tracked = Support(tracks=0, contact_edges=4), Support(tracks=9, contact_edges=4)
    planes = [replace(plane, support=touched if i == 3 else tracked) for i, plane in enumerate(room.planes)]
    room = replace(room, planes=planes)
    taken = take_dimensions(room, offsets(6, 0.001), 20)
    status = {(one.first, one.second): one.accuracy.status for one in taken.dimensions if one.accuracy}
    assert status == {(0, 1): "within", (2, 3): "inferred", (4, 5): "within"}
    assert [one.accuracy.level for one in taken.dimensions if one.accuracy] == [40, 40, 40]
    # It is what to measure next, though its σ is small.
    assert taken.next_measurement == NextMeasurement(1, within=2, reached=3, of=3)
    by_hand = Measurement("between", ("wall_2", "wall_3"), 4.0, 0.003)
    for used, expected in ((True, "within"), (False, "inferred")):
        checked = Checked(by_hand, 4.0, 0.003, used)
        after = as_measured(room.instances, taken.dimensions, [checked], 20)
        assert [one.accuracy.status for one in after if one.accuracy] == ["within", expected, "within"]


def test_a_door_is_where_its_wall_is() -> None:
    """Its own plane has no track; that of the wall it lies in has some, or none."""
    door = replace(rooms.FAR, label="door", host=4)
    surfaces = (*rooms.BOX[:5], door)
    for tracks, expected in ((9, False), (0, True)):
        room = room_of(surfaces)
        wall = replace(room.planes[4], support=Support(tracks=tracks, contact_edges=2))
        room = replace(room, planes=[*room.planes[:4], wall, room.planes[5]])
        assert by_neighbours(room, 5) is expected


def test_a_dimension_that_can_be_checked_goes_first() -> None:
    """All share a scale, so any brings all to LOA30. The longest tells most, but would hide the largest slip."""
    room = room_of(rooms.BOX)
    lengths = np.zeros(24)
    lengths[[7, 15, 23]] = rooms.HEIGHT_M, rooms.WIDTH_M, rooms.DEPTH_M
    for share, checked in ((0.0045, True), (0.006, False)):
        taken = take_dimensions(room, share**2 * np.outer(lengths, lengths) + offsets(6, 1e-4), 30)
        following = taken.next_measurement
        assert following is not None
        proposed = taken.dimensions[following.dimension]
        assert (proposed.kind, following.reached) == ("height", 3)
        assert (NAMED * np.hypot(proposed.sigma, TAPE_SIGMA_M) <= GROSS_M) == checked


def test_without_a_unit_nothing_has_a_level_and_the_best_known_length_is_proposed() -> None:
    room = room_of(rooms.BOX)
    room = replace(room, scene=replace(room.scene, metric=False))
    covariance = offsets(6, 0.001)
    covariance[3, 3] = 0.04**2
    taken = take_dimensions(room, covariance, 20)
    assert {one.status for one in taken.accuracies} == {"insufficient evidence"}
    assert taken.next_measurement is not None
    best = taken.dimensions[taken.next_measurement.dimension]
    assert (best.first, best.second) == (4, 5), "5 m as well known as 4 m"


def test_a_plane_that_nothing_places_is_left_out() -> None:
    lost = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False)
    room = room_of(rooms.BOX)
    planes = [*room.planes[:5], lost]
    covariance = offsets(6, 0.01)
    covariance[20:], covariance[:, 20:] = np.nan, np.nan
    taken = take_dimensions(replace(room, planes=planes), covariance, 20)
    assert all(np.isfinite(one.sigma) for one in taken.dimensions)
    assert taken.accuracies[5].status == "insufficient evidence"
    assert all(5 not in one.instances for one in taken.quantities)
