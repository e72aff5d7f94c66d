"""The paper's optimiser: gradients against numeric ones, losses in closed form, and what a descent does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from shapely import MultiPolygon

from common import adam
from gtlayout.instances import Instance
from gtlayout.scene import FloatArray
from simulated import simulated_edges, simulated_room, simulation

ONLY_TRACKS = adam.AdamConfig(edge_weight=0.0, perpendicularity_weight=0.0)
ONLY_EDGES = adam.AdamConfig(track_weight=0.0, perpendicularity_weight=0.0)
ONLY_ANGLES = adam.AdamConfig(track_weight=0.0, edge_weight=0.0)


@pytest.fixture(scope="module")
def orbit() -> simulated_room.Room:
    return simulated_room.make_room(simulated_room.orbit(), [0, 10, 20])


@pytest.fixture(scope="module")
def problem(orbit: simulated_room.Room) -> adam.Problem:
    tracks = simulation.make_tracks(orbit, np.random.default_rng(0), sigma_px=0.0)
    return adam.problem(
        orbit.scene, tracks, simulation.true_instance(orbit, tracks), orbit.instances, simulated_edges.true_edges(orbit)
    )


def _local(problem: adam.Problem, planes: FloatArray) -> FloatArray:
    return np.column_stack([planes[:, :3] @ problem.axes.T, planes[:, 3] + planes[:, :3] @ problem.origin])


def _objective(
    problem: adam.Problem, config: adam.AdamConfig | None = None, dtype: npt.DTypeLike = np.float64
) -> adam.Objective:
    return adam.Objective(problem, config or adam.AdamConfig(), np.arange(len(problem.track_length)), dtype)


def _off_the_truth(problem: adam.Problem, orbit: simulated_room.Room) -> FloatArray:
    """Where no norm is near its kink; planes of any scale."""
    rng = np.random.default_rng(1)
    planes = _local(problem, orbit.planes) + rng.normal(0, 0.1, orbit.planes.shape)
    return planes * rng.uniform(0.5, 2.0, (len(planes), 1))


@pytest.mark.parametrize("config", [ONLY_TRACKS, ONLY_EDGES, ONLY_ANGLES, adam.AdamConfig()])
def test_gradients(problem: adam.Problem, orbit: simulated_room.Room, config: adam.AdamConfig) -> None:
    planes = _off_the_truth(problem, orbit)
    objective = _objective(problem, config)
    value, gradient = objective(planes)
    assert value > 0
    numeric = np.zeros_like(planes)
    for index in np.ndindex(planes.shape):
        step = np.zeros_like(planes)
        step[index] = 1e-6
        numeric[index] = (objective(planes + step)[0] - objective(planes - step)[0]) / 2e-6
    np.testing.assert_allclose(gradient, numeric, rtol=1e-6, atol=1e-6 * np.abs(numeric).max())


def test_single_precision_gives_the_same(problem: adam.Problem, orbit: simulated_room.Room) -> None:
    planes = _off_the_truth(problem, orbit)
    value, gradient = _objective(problem)(planes)
    rough_value, rough_gradient = _objective(problem, dtype=np.float32)(planes)
    assert rough_value == pytest.approx(value, rel=1e-5)
    np.testing.assert_allclose(rough_gradient, gradient, atol=1e-4 * np.abs(gradient).max())


def test_the_loss_of_the_truth_is_zero(problem: adam.Problem, orbit: simulated_room.Room) -> None:
    assert _objective(problem)(_local(problem, orbit.planes))[0] == pytest.approx(0.0, abs=1e-9)


def test_scale_of_a_plane_changes_nothing(problem: adam.Problem, orbit: simulated_room.Room) -> None:
    planes = _off_the_truth(problem, orbit)
    scaled = planes * np.linspace(0.2, 5.0, len(planes))[:, None]
    assert _objective(problem)(scaled)[0] == pytest.approx(_objective(problem)(planes)[0], rel=1e-9)


def test_the_losses_in_closed_form() -> None:
    """A track seen straight ahead from x = ∓1: its points lie two metres apart on z = 5, each 1 m from their mean. An
    edge point's ray, 1.25 long, meets z = 5 and z = 4. Normals 60° apart have the cosine 1/2.
    """
    problem = adam.Problem(
        surface=np.array([0, 1]),
        origin=np.zeros(3),
        axes=np.eye(3),
        views=np.array([[-1.0, 0, 0, 1, 0, 0, 1], [1.0, 0, 0, 1, 0, 0, 1]]).T,
        track_length=np.array([2]),
        track_instance=np.array([0]),
        edge_views=np.array([[0.0, 0, 0, 1, 0.75, 0, 1]]).T,
        edge_instances=np.array([[0], [1]]),
        perpendicular=np.array([[0.0, 1.0], [1.0, 0.0]]),
    )
    planes = np.array([[0.0, 0, -1, 5], [0, 0, -1, 4]])
    assert _objective(problem, ONLY_TRACKS)(planes)[0] == pytest.approx(1.0)
    assert _objective(problem, ONLY_EDGES)(planes)[0] == pytest.approx(0.1 * 1.25)
    turned = np.array([[0.0, 0, -1, 5], [0, np.sqrt(0.75), -0.5, 4]])
    assert _objective(problem, ONLY_ANGLES)(turned)[0] == pytest.approx(0.1 * 0.5)


def test_the_loss_is_the_sum_of_its_terms(problem: adam.Problem, orbit: simulated_room.Room) -> None:
    planes = _off_the_truth(problem, orbit)
    parts = [_objective(problem, config)(planes)[0] for config in (ONLY_TRACKS, ONLY_EDGES, ONLY_ANGLES)]
    assert sum(parts) == pytest.approx(_objective(problem)(planes)[0])


def test_near_the_truth_adam_finds_it(problem: adam.Problem, orbit: simulated_room.Room) -> None:
    """Planes turned by up to 4° and moved by 5 cm come back."""
    rng = np.random.default_rng(2)
    start = _local(problem, orbit.planes) + rng.uniform(-0.05, 0.05, orbit.planes.shape)
    run = adam.run(problem, adam.AdamConfig(learning_rate=0.003), 0, 0, start)
    assert run.loss < 2e-3
    np.testing.assert_allclose(run.planes, orbit.planes, atol=0.02)


def test_descents_on_one_plane_find_it(orbit: simulated_room.Room) -> None:
    """From planes of ones, as the paper starts. Of several planes together some descents end in other basins."""
    tracks = simulation.make_tracks(orbit, np.random.default_rng(0), sigma_px=0.0)
    of = simulation.true_instance(orbit, tracks)
    found = []
    for i, instance in enumerate(orbit.instances):
        alone = adam.problem(orbit.scene, tracks, np.where(of == i, 0, -1), [instance], [])
        run = adam.run(alone, adam.AdamConfig(), 0, 0)
        assert np.linalg.norm(run.planes[0, :3]) == pytest.approx(1.0)
        found.append(bool(np.abs(run.planes[0] - orbit.planes[i]).max() < 0.05))
    assert np.mean(found) > 0.5, found


def test_runs_are_deterministic_and_differ(problem: adam.Problem) -> None:
    config = adam.AdamConfig(max_iterations=60)
    first, again, other = (adam.run(problem, config, 0, number) for number in (1, 1, 2))
    np.testing.assert_array_equal(first.planes, again.planes)
    assert (first.loss, first.iterations) == (again.loss, again.iterations) and first.loss != other.loss
    assert first.iterations == 60


def test_a_run_stops_without_improvement(problem: adam.Problem) -> None:
    run = adam.run(problem, adam.AdamConfig(learning_rate=0.0, patience=7), 0, 0)
    assert run.iterations == 8


def test_what_nothing_places_is_nan_not_a_guess(orbit: simulated_room.Room) -> None:
    """A wall that has neither tracks nor edges; a door has its host's plane."""
    tracks = simulation.make_tracks(orbit, np.random.default_rng(0), sigma_px=0.0)
    instances = (*orbit.instances, Instance("wall_9", "wall", ((0, 0),)), Instance("door_0", "door", ((0, 0),), host=0))
    of = simulation.true_instance(orbit, tracks)
    problem = adam.problem(orbit.scene, tracks, of, instances, simulated_edges.true_edges(orbit))
    planes = adam.run(problem, adam.AdamConfig(max_iterations=20), 0, 0).planes
    assert np.isnan(planes[-2]).all()
    np.testing.assert_array_equal(planes[-1], planes[0])
    assert np.isfinite(planes[: len(orbit.instances)]).all()


def test_without_any_evidence_all_is_nan(orbit: simulated_room.Room) -> None:
    tracks = simulation.no_tracks(orbit.scene)
    problem = adam.problem(orbit.scene, tracks, np.empty(0, dtype=np.int64), orbit.instances, [])
    assert np.isnan(adam.run(problem, adam.AdamConfig(max_iterations=5), 0, 0).planes).all()


def test_a_loss_that_is_no_number_ends_the_run(problem: adam.Problem) -> None:
    run = adam.run(replace(problem, views=np.full_like(problem.views, np.nan)), adam.AdamConfig(), 0, 0)
    assert run.iterations == 1 and run.loss == np.inf
    assert np.isnan(run.planes).all()


def test_tracks_on_furniture_count_only_where_a_plane_has_no_others(orbit: simulated_room.Room) -> None:
    """An element of the first key frame loses its visible parts; then an instance loses all of them."""
    tracks = simulation.make_tracks(orbit, np.random.default_rng(0), sigma_px=0.0)
    of = simulation.true_instance(orbit, tracks)
    hidden = tuple(
        replace(frame, elements=tuple(replace(e, visible=MultiPolygon()) for e in frame.elements))
        for frame in orbit.scene.key_frames
    )
    partly = replace(orbit.scene, key_frames=(hidden[0], *orbit.scene.key_frames[1:]))
    nowhere = replace(orbit.scene, key_frames=hidden)
    counts = [
        len(adam.problem(scene, tracks, of, orbit.instances, []).track_length)
        for scene in (orbit.scene, partly, nowhere)
    ]
    in_first = int(np.sum(tracks.key_frame == 0))
    only_there = sum(int(np.sum(of == i)) for i in set(of) if (tracks.key_frame[of == i] == 0).all())
    assert counts == [len(tracks), len(tracks) - in_first + only_there, len(tracks)]


def test_a_share_of_each_planes_tracks_is_drawn(problem: adam.Problem) -> None:
    chosen = adam.draw(problem, 0.5, np.random.default_rng(0))
    have = np.bincount(problem.track_instance)
    got = np.bincount(problem.track_instance[chosen])
    np.testing.assert_array_equal(got, np.ceil(have / 2))
    assert (np.diff(chosen) > 0).all()
