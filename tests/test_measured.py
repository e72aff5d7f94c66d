"""Measurements by hand: planes and scale given them in closed form, contradictions, and rooms that get a unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import rooms
import solved_rooms
from test_solved_room import DOOR, offsets, room_of

from gtlayout.dimensions.measurable import Measurable
from gtlayout.measured.conditioning import condition
from gtlayout.measured.measurables import NotMeasurableError, measurable_of
from gtlayout.measurement import NAMED, PULL, SURE, ElementName, Measurement
from gtlayout.method import with_measurements
from gtlayout.results.tables import measurement_lines
from gtlayout.scene import FloatArray
from gtlayout.solution import Solution

HEIGHT = Measurement("between", ("floor_0", "ceiling_1"), 2.53, 0.003)
WIDTH = Measurement("between", ("wall_2", "wall_3"), rooms.WIDTH_M, 0.003)
DEPTH = Measurement("between", ("wall_4", "wall_5"), rooms.DEPTH_M, 0.003)


def solution_of(
    sigma: float, *measurements: Measurement, metric: bool = True, covariance: FloatArray | None = None
) -> Solution:
    """The box room as if solved, with planes that are off by σ each by itself."""
    ahead = rooms.level_camera([2.0, 0.3, 1.25], 200.0, 640, 480)
    back = ahead.placed(ahead.R_cam_from_world @ np.diag([-1.0, -1.0, 1.0]), np.array([2.0, 4.7, 1.25]))
    cameras = [ahead, back, ahead.placed(ahead.R_cam_from_world, np.array([1.5, 0.4, 1.2]))]
    solution = solved_rooms.solved(cameras, (), rooms.BOX, sigma)
    joint = solution.estimate.covariance if covariance is None else covariance
    scene = replace(solution.scene, measurements=measurements, metric=metric)
    landmarks = np.zeros((0, 3))
    estimate = replace(solution.estimate, covariance=joint, landmarks=landmarks)
    return replace(solution, scene=scene, estimate=estimate, quality=solution.quality)


def length(solution: Solution, kind: str) -> tuple[float, float]:
    (one,) = [one for one in solution.layout.dimensions if one.kind == kind and {one.first, one.second} != {4, 5}]
    return one.length, one.sigma


def test_one_measured_length_is_the_weighted_mean_and_both_planes_share_the_change() -> None:
    """Two planes with σ 2 cm each: σ of their distance is 2.83 cm, and the tape has 3 mm."""
    solution = with_measurements(solution_of(0.02, replace(HEIGHT, value=2.51)))
    prior, tape = 2 * 0.02**2, 0.003**2
    moved = 0.01 * prior / (prior + tape)
    found, sigma = length(solution, "height")
    assert found == pytest.approx(rooms.HEIGHT_M + moved, abs=1e-6)
    assert sigma == pytest.approx(np.sqrt(prior * tape / (prior + tape)), rel=1e-3)
    assert [plane.d for plane in solution.planes[:2]] == pytest.approx(
        [moved / 2, rooms.HEIGHT_M + moved / 2], abs=1e-6
    )
    assert length(solution, "width") == pytest.approx((rooms.WIDTH_M, 0.02 * np.sqrt(2))), "not touched"
    (checked,) = solution.layout.measurements
    assert checked.used
    assert (checked.predicted, checked.predicted_sigma) == pytest.approx((rooms.HEIGHT_M, 0.02 * np.sqrt(2)))
    assert solution.layout.scale is not None
    assert (solution.layout.scale.factor, solution.new_cameras) == (1.0, False)


def test_what_planes_share_moves_together() -> None:
    """All walls off by one common share: the height alone tells the width."""
    gradient = np.zeros(24)
    gradient[[3, 7, 11, 15]] = [0.0, rooms.HEIGHT_M, 0.0, rooms.WIDTH_M]
    common = 0.02**2 * np.outer(gradient, gradient) + offsets(6, 1e-6)
    measured = replace(HEIGHT, value=1.01 * rooms.HEIGHT_M, sigma=1e-6)
    solution = with_measurements(solution_of(0.0, measured, covariance=common))
    found, sigma = length(solution, "width")
    assert found == pytest.approx(1.01 * rooms.WIDTH_M, abs=1e-4)
    assert sigma < 1e-4


def test_a_measurement_that_contradicts_is_named_and_moves_nothing() -> None:
    before = solution_of(0.005)
    wrong = with_measurements(replace(before, scene=replace(before.scene, measurements=(replace(HEIGHT, value=2.56),))))
    (checked,) = wrong.layout.measurements
    assert not checked.used
    assert checked.deviations == pytest.approx(0.06 / np.hypot(0.005 * np.sqrt(2), 0.003))
    assert [plane.d for plane in wrong.planes] == pytest.approx([plane.d for plane in before.planes], abs=1e-12)
    (warning,) = wrong.scene.warnings
    assert "floor_0 – ceiling_1 = 2.560 m is not used: everything else says 2.500 ± 0.007 m" in warning


def test_the_limit_is_where_one_of_a_hundred_right_ones_lies() -> None:
    sigma = np.hypot(0.005 * np.sqrt(2), 0.003)
    for factor, used in ((0.99, True), (1.01, False)):
        measured = replace(HEIGHT, value=rooms.HEIGHT_M + factor * SURE * sigma)
        assert with_measurements(solution_of(0.005, measured)).layout.measurements[0].used is used


def test_what_could_be_a_slip_moves_nothing_by_more_than_its_sigma() -> None:
    """Two σ from the video: it may be right, and counts so much less that the height moves by ``PULL`` σ of both."""
    video = 0.02 * np.sqrt(2)
    both = np.hypot(video, 0.003)
    measured = replace(HEIGHT, value=rooms.HEIGHT_M + 2 * both)
    solution = with_measurements(solution_of(0.02, measured))
    (checked,) = solution.layout.measurements
    assert checked.used and checked.held_back
    assert checked.counted_sigma == pytest.approx(np.hypot(0.003, both * np.sqrt(2 / PULL - 1)), rel=0.03)
    assert length(solution, "height")[0] - rooms.HEIGHT_M == pytest.approx(PULL * video**2 / both, rel=0.03)
    assert length(solution, "height")[1] == pytest.approx(video * np.sqrt(1 - PULL / 2), rel=0.03)
    assert checked.hidden_slip == pytest.approx(NAMED * both, rel=1e-3)
    (line, *_) = measurement_lines(solution.layout)
    assert line.endswith("could hide a slip of up to 12.0 cm; measure it a second time")


def test_a_second_measurement_that_agrees_frees_the_first() -> None:
    measured = replace(HEIGHT, value=rooms.HEIGHT_M + 2 * 0.02 * np.sqrt(2))
    solution = with_measurements(solution_of(0.02, measured, replace(measured, value=measured.value + 0.002)))
    assert not any(one.held_back for one in solution.layout.measurements)
    assert length(solution, "height")[0] == pytest.approx(measured.value + 0.001, abs=1e-3)
    assert length(solution, "height")[1] == pytest.approx(0.003 / np.sqrt(2), rel=0.02)
    (line, *_) = measurement_lines(solution.layout)
    assert line.endswith("; it could hide a slip of up to 1.8 cm"), "the other knows better than the video"


def test_of_two_readings_the_video_tells_which_is_wrong_where_it_can() -> None:
    """5 cm apart: where the video knows 1.4 cm it is clear, where it knows 14 cm neither is used."""
    right, wrong = replace(HEIGHT, value=rooms.HEIGHT_M), replace(HEIGHT, value=rooms.HEIGHT_M + 0.05)
    clear, unclear = (with_measurements(solution_of(sigma, right, wrong)) for sigma in (0.01, 0.1))
    assert [one.used for one in clear.layout.measurements] == [True, False]
    assert [one.used for one in unclear.layout.measurements] == [False, False]


def test_a_door_measured_twice_checks_itself_though_its_drawing_is_off() -> None:
    """What is drawn of it is off alike for both: by the second the first is known to 3 mm, not to 3 cm."""
    door = Measurement("width", ("door_6",), 0.9, 0.003)
    drawn = Measurable(0.9, np.zeros(24), 0.03)
    posterior = condition(offsets(6, 0.01), [door, replace(door, value=0.95)], [drawn, drawn], 0.0)
    assert posterior is not None
    assert not any(one.used and not one.held_back for one in posterior.checked)
    posterior = condition(offsets(6, 0.01), [door, replace(door, value=0.902)], [drawn, drawn], 0.0)
    assert posterior is not None
    assert [one.predicted_sigma for one in posterior.checked] == pytest.approx([0.003, 0.003], rel=0.02)
    other = replace(door, instances=("door_7",), value=0.902)
    posterior = condition(offsets(6, 0.01), [door, other], [drawn, drawn], 0.0)
    assert posterior is not None
    assert [one.predicted_sigma for one in posterior.checked] == pytest.approx([0.03, 0.03], rel=0.02)


def test_of_three_the_wrong_one_is_found_though_only_the_others_tell() -> None:
    """The scale of the scene is not known at all: two agree on it, the third does not."""
    wrong = replace(DEPTH, value=1.05 * rooms.DEPTH_M)
    right = (replace(HEIGHT, value=rooms.HEIGHT_M), WIDTH)
    solution = with_measurements(solution_of(0.002, *right, wrong, metric=False))
    assert [one.used for one in solution.layout.measurements] == [True, True, False]
    scale = solution.layout.scale
    assert scale is not None
    assert scale.factor == pytest.approx(1.0, abs=1e-3)
    assert scale.gave_unit


def test_two_that_contradict_each_other_give_no_unit() -> None:
    wrong = replace(DEPTH, value=1.2 * rooms.DEPTH_M)
    solution = with_measurements(solution_of(0.002, WIDTH, wrong, metric=False))
    assert solution.layout.scale is None
    assert not solution.new_cameras
    assert "contradict one another" in solution.scene.warnings[-1]


def test_a_length_gives_the_scene_its_unit_with_a_sigma_that_is_in_all_others() -> None:
    """The room in units of 2 m; σ of the scale is that of the width, and of the depth that of both."""
    solution = with_measurements(solution_of(0.004, replace(WIDTH, value=2 * rooms.WIDTH_M, sigma=0.02), metric=False))
    scale = solution.layout.scale
    assert scale is not None
    share = np.hypot(0.004 * np.sqrt(2) / rooms.WIDTH_M, 0.02 / (2 * rooms.WIDTH_M))
    assert scale.gave_unit
    assert (scale.factor, scale.sigma_share) == pytest.approx((2.0, share))
    assert solution.layout.metric and solution.scene.metric and solution.new_cameras
    (depth,) = [one for one in solution.layout.dimensions if {one.first, one.second} == {4, 5}]
    assert depth.length == pytest.approx(2 * rooms.DEPTH_M)
    own = 2 * 0.004 * np.sqrt(2)
    assert depth.sigma == pytest.approx(np.hypot(own, 2 * rooms.DEPTH_M * share), rel=1e-6)
    assert length(solution, "width")[1] == pytest.approx(0.02, rel=1e-6), "its own σ is the tape's"
    (floor,) = [one for one in solution.layout.quantities if one.kind == "floor area"]
    assert floor.amount == pytest.approx(4 * rooms.WIDTH_M * rooms.DEPTH_M)
    for frame, old in zip(solution.scene.frames, solution_of(0.004).scene.frames, strict=True):
        np.testing.assert_allclose(frame.camera.center_world, 2 * old.camera.center_world)


def test_the_scale_is_doubted_about_the_cameras_wherever_the_world_begins() -> None:
    """σ of a plane's place grows with its distance from the cameras, not from the world's origin."""
    solution = solution_of(0.0)
    doubted = with_measurements(replace(solution, scene=replace(solution.scene, scale_sigma_share=0.01)))
    eye = np.mean([frame.camera.center_world for frame in solution.scene.frames], axis=0)
    for plane in doubted.planes[:2]:
        foot = eye - (plane.normal @ eye + plane.d) * plane.normal
        assert plane.sigma_offset(foot) == pytest.approx(0.01 * abs(plane.normal @ eye + plane.d))
    assert length(doubted, "width") == pytest.approx((rooms.WIDTH_M, 0.01 * rooms.WIDTH_M))
    (floor,) = [one for one in doubted.layout.quantities if one.kind == "floor area"]
    assert floor.sigma == pytest.approx(0.02 * rooms.WIDTH_M * rooms.DEPTH_M), "an area is a square"


def test_nothing_measured_changes_nothing() -> None:
    solution = solution_of(0.01)
    same = with_measurements(solution)
    assert same.layout is solution.layout and same.estimate is solution.estimate


def test_angles_count_in_degrees() -> None:
    """Left and far wall turn by σ 1° each about the vertical: their angle has 1.41°, and the set square .5°."""
    turn = np.zeros((24, 24))
    turn[9, 9] = turn[16, 16] = np.deg2rad(1.0) ** 2
    measured = Measurement("angle", ("wall_2", "wall_4"), 90.9, 0.5)
    solution = with_measurements(solution_of(0.0, measured, covariance=turn + offsets(6, 1e-3)))
    a, b = solution.planes[2].normal, solution.planes[4].normal
    assert np.rad2deg(np.arccos(a @ b)) == pytest.approx(90 + 0.9 * 2 / (2 + 0.25), abs=1e-3)
    (checked,) = solution.layout.measurements
    assert (checked.predicted, checked.predicted_sigma) == pytest.approx((90.0, np.sqrt(2)))


def test_what_is_measured_of_a_door_is_what_its_dimension_says() -> None:
    room = room_of((*rooms.BOX, DOOR), sigma=0.01)
    assert measurable_of(room, Measurement("width", ("door_6",), 0.9, 0.003)).value == pytest.approx(0.9)
    with pytest.raises(NotMeasurableError, match="not seen whole"):
        measurable_of(room, Measurement("sill", ("door_6",), 0.9, 0.003))
    with pytest.raises(NotMeasurableError, match="neither door nor window"):
        measurable_of(room, Measurement("height", ("wall_2",), 0.9, 0.003))


@pytest.mark.parametrize(
    ("measurement", "reason"),
    [
        (replace(HEIGHT, instances=("floor_0", "wall_9")), "no instance wall_9"),
        (replace(HEIGHT, instances=("floor_0", "wall_2")), "further than 10° from parallel"),
        (Measurement("angle", ("wall_2", "wall_3"), 180.0, 0.5), "below 6° or above 174°"),
        (replace(HEIGHT, elements=(ElementName("0.png", "gone"), None)), r"floor_0 \(element gone of 0.png\)"),
    ],
)
def test_what_is_not_there_is_left_out_and_said(measurement: Measurement, reason: str) -> None:
    solution = with_measurements(solution_of(0.01, measurement))
    (warning,) = solution.scene.warnings
    assert warning.startswith(f"measurement {measurement.name} left out: ")
    with pytest.raises(NotMeasurableError, match=reason):
        measurable_of(room_of(rooms.BOX), measurement)


def test_an_element_finds_its_instance_under_another_name() -> None:
    moved = replace(
        HEIGHT, instances=("floor_7", "ceiling_8"), elements=(ElementName("0.png", "e0"), ElementName("0.png", "e1"))
    )
    assert measurable_of(room_of(rooms.BOX), moved).value == pytest.approx(rooms.HEIGHT_M)


def test_surfaces_that_look_the_same_way_have_a_distance() -> None:
    """A wall stub .5 m before the left wall."""
    stub = rooms.Surface("wall", rooms.rectangle([0.5, 1, 0], [0, 1, 0], rooms.Z))
    room = room_of((*rooms.BOX, stub))
    between = measurable_of(room, Measurement("between", ("wall_6", "wall_2"), 0.5, 0.003))
    assert between.value == pytest.approx(0.5)
    assert between.gradient[[4 * 6 + 3, 4 * 2 + 3]] == pytest.approx([-1.0, 1.0])


def test_two_marked_points_tell_the_scale() -> None:
    """The ends of a line on the far wall, 3 m apart, marked in two images, in a room in units of half a metre."""
    solution = solution_of(0.01, metric=False)
    corners = np.array([[0.5, rooms.DEPTH_M, 0.2], [3.5, rooms.DEPTH_M, 0.2]])
    points = tuple(
        tuple(
            (frame.name, tuple(frame.camera.project(corner[None])[0][0].tolist()))
            for frame in (solution.scene.frames[0], solution.scene.frames[2])
        )
        for corner in corners
    )
    measured = Measurement("points", (), 1.5, 0.003, points=points)
    solution = with_measurements(replace(solution, scene=replace(solution.scene, measurements=(measured,))))
    assert solution.layout.scale is not None
    assert solution.layout.scale.factor == pytest.approx(0.5)
    assert 0.003 / 1.5 < solution.layout.scale.sigma_share < 0.05, "marks are good to a pixel"


def test_the_covariance_stays_one() -> None:
    """Symmetric, without negative variances, smaller than before in every direction."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(24, 24)) * 0.01
    prior = root @ root.T
    measurables = [Measurable(2.5, rng.normal(size=24), 0.002) for _ in range(5)]
    measurements = [replace(HEIGHT, value=2.5)] * 5
    posterior = condition(prior, measurements, measurables, 0.01)
    assert posterior is not None
    after = posterior.covariance[:24, :24]
    np.testing.assert_array_equal(after, after.T)
    assert np.linalg.eigvalsh(prior - after).min() > -1e-12
    assert np.linalg.eigvalsh(after).min() > -1e-12
