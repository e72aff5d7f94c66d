"""The paper's optimiser: gradients against numeric ones, losses in closed form, and what a descent does."""

from __future__ import annotations

import numpy as np
import pytest
import simulation

import adam
from gtlayout.layout import Instance
from gtlayout.scene import FloatArray


@pytest.fixture(scope="module")
def orbit() -> simulation.Room:
    return simulation.make_room(simulation.orbit(), [0, 10, 20])


@pytest.fixture(scope="module")
def problem(orbit: simulation.Room) -> adam.Problem:
    tracks = simulation.make_tracks(orbit, np.random.default_rng(0), sigma_px=0.0)
    return adam.problem(
        orbit.scene, tracks, simulation.true_instance(orbit, tracks), orbit.instances, simulation.true_edges(orbit)
    )


def _local(problem: adam.Problem, planes: FloatArray) -> FloatArray:
    return np.column_stack([planes[:, :3], planes[:, 3] + planes[:, :3] @ problem.origin])


def _objective(problem: adam.Problem, config: adam.AdamConfig | None = None) -> adam.Objective:
    return adam.Objective(problem, config or adam.AdamConfig(), np.arange(len(problem.track_length)))


@pytest.mark.parametrize("term", ["track_loss", "edge_loss", "perpendicularity_loss"])
def test_gradients(problem: adam.Problem, orbit: simulation.Room, term: str) -> None:
    """Away from the truth, where no norm is near its kink; planes of any scale."""
    rng = np.random.default_rng(1)
    planes = _local(problem, orbit.planes) + rng.normal(0, 0.1, orbit.planes.shape)
    planes *= rng.uniform(0.5, 2.0, (len(planes), 1))
    loss = getattr(_objective(problem), term)
    value, gradient = loss(planes)
    assert value > 0
    numeric = np.zeros_like(planes)
    for index in np.ndindex(planes.shape):
        step = np.zeros_like(planes)
        step[index] = 1e-6
        numeric[index] = (loss(planes + step)[0] - loss(planes - step)[0]) / 2e-6
    np.testing.assert_allclose(gradient, numeric, rtol=1e-5, atol=1e-7 * np.abs(numeric).max())


def test_the_loss_of_the_truth_is_zero(problem: adam.Problem, orbit: simulation.Room) -> None:
    value, _ = _objective(problem)(_local(problem, orbit.planes))
    assert value == pytest.approx(0.0, abs=1e-9)


def test_scale_of_a_plane_changes_nothing(problem: adam.Problem, orbit: simulation.Room) -> None:
    planes = _local(problem, orbit.planes) + 0.05
    scaled = planes * np.linspace(0.2, 5.0, len(planes))[:, None]
    assert _objective(problem)(scaled)[0] == pytest.approx(_objective(problem)(planes)[0], rel=1e-12)


def _two_views(edge_rays: FloatArray | None = None) -> adam.Problem:
    """One track seen from x = ∓1, straight ahead in z; two walls, and edge points seen from the origin."""
    rays = np.empty((0, 3)) if edge_rays is None else edge_rays
    return adam.Problem(
        surface=np.array([0, 1]),
        origin=np.zeros(3),
        views=np.array([[-1.0, 0, 0, 1, 0, 0, 1], [1.0, 0, 0, 1, 0, 0, 1]]).T.copy(),
        track_length=np.array([2]),
        track_surface=np.array([0]),
        edge_centers=np.tile([[0.0], [0], [0], [1]], len(rays)),
        edge_rays=rays.T.copy(),
        edge_surfaces=np.tile([[0], [1]], len(rays)),
        perpendicular=np.array([[0.0, 1.0], [1.0, 0.0]]),
    )


def test_the_losses_in_closed_form() -> None:
    """Both rays meet the plane z = 5 two metres apart: each is 1 m from the middle. The edge's ray meets the planes at
    depths 5 and 4, and is 1.25 long. The normals are 60° apart: cosine 1/2.
    """
    problem = _two_views(np.array([[0.75, 0.0, 1.0]]))
    planes = np.array([[0.0, 0, -1, 5], [0, 0, -1, 4]])
    objective = _objective(problem)
    assert objective.track_loss(planes)[0] == pytest.approx(1.0)
    assert objective.edge_loss(planes)[0] == pytest.approx(0.1 * 1.25)
    turned = np.array([[0.0, 0, -1, 5], [0, np.sqrt(0.75), -0.5, 4]])
    assert objective.perpendicularity_loss(turned)[0] == pytest.approx(0.1 * 0.5)


def test_each_plane_weighs_the_same_however_many_tracks_it_has(problem: adam.Problem, orbit: simulation.Room) -> None:
    """Only one plane is off: half of its tracks give the same loss but for which half it is."""
    planes = _local(problem, orbit.planes)
    planes[0, 3] *= 1.1
    own = np.nonzero(problem.track_surface == 0)[0]
    others = np.nonzero(problem.track_surface != 0)[0]
    config = adam.AdamConfig()
    whole = adam.Objective(problem, config, np.arange(len(problem.track_length))).track_loss(planes)[0]
    half = adam.Objective(problem, config, np.sort(np.concatenate([own[::2], others]))).track_loss(planes)[0]
    assert half == pytest.approx(whole, rel=0.2)


def test_descents_on_one_plane_find_it(orbit: simulation.Room) -> None:
    """Of several planes together most descents from ones end in other basins: that is why the paper makes 100."""
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


def test_what_nothing_places_is_nan_not_a_guess(orbit: simulation.Room) -> None:
    """A third wall that has neither tracks nor edges, and a door with its host's plane."""
    tracks = simulation.make_tracks(orbit, np.random.default_rng(0), sigma_px=0.0)
    instances = (*orbit.instances, Instance("wall_9", "wall", ((0, 0),)), Instance("door_0", "door", ((0, 0),), host=0))
    of = simulation.true_instance(orbit, tracks)
    problem = adam.problem(orbit.scene, tracks, of, instances, simulation.true_edges(orbit))
    planes = adam.run(problem, adam.AdamConfig(max_iterations=20), 0, 0).planes
    assert np.isnan(planes[-2]).all()
    np.testing.assert_array_equal(planes[-1], planes[0])
    assert np.isfinite(planes[: len(orbit.instances)]).all()


def test_a_weight_of_zero_leaves_a_term_out(problem: adam.Problem, orbit: simulation.Room) -> None:
    planes = _local(problem, orbit.planes) + 0.05
    full, _ = _objective(problem)(planes)
    left_out = [
        adam.AdamConfig(track_weight=0.0),
        adam.AdamConfig(edge_weight=0.0),
        adam.AdamConfig(perpendicularity_weight=0.0),
    ]
    parts = [_objective(problem, config)(planes)[0] for config in left_out]
    assert all(part < full for part in parts)
    assert sum(parts) == pytest.approx(2 * full)


def test_half_of_each_planes_tracks_are_drawn(problem: adam.Problem) -> None:
    chosen = adam.draw(problem, 0.5, np.random.default_rng(0))
    have = np.bincount(problem.track_surface)
    got = np.bincount(problem.track_surface[chosen])
    np.testing.assert_array_equal(got, np.ceil(have / 2))
    assert (np.diff(chosen) > 0).all()
