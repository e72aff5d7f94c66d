"""Landmarks that are eliminated at once: the same problem as GTSAM's graph of landmarks, factor by factor."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, P

from gtlayout.factors import plane_prior_factor, track_factor
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.landmarks import Landmarks
from gtlayout.planes.problem import Problem
from gtlayout.scene import Camera, FloatArray
from gtlayout.tracking.config import TriangulationConfig
from gtlayout.tracking.triangulation import triangulate
from simulated.simulated_room import Room, make_room, orbit
from simulated.simulation import make_tracks, true_instance

CONFIG = EstimationConfig()


@pytest.fixture(scope="module")
def room() -> Room:
    return make_room(orbit(), [2, 10, 18])


@pytest.fixture(scope="module")
def problem(room: Room) -> tuple[Problem, gtsam.Values, FloatArray]:
    """Landmarks with priors on planes, the values a little beside the truth."""
    rng = np.random.default_rng(0)
    tracks = make_tracks(room, rng, per_element=4)
    used = np.nonzero(np.arange(len(tracks)) % 5 > 0)[0]
    plane = true_instance(room, tracks)[used]
    start = triangulate(room.scene, tracks, TriangulationConfig()).points_world()[used]
    start += 0.02 * rng.normal(size=(len(used), 3))
    observed = rng.random(len(tracks.track)) < 0.8
    cameras = [frame.camera for frame in room.scene.frames]
    weight = rng.uniform(0.1, 1.0, len(used))
    landmarks = Landmarks.of(cameras, tracks, used, observed, plane, start, weight, CONFIG)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    placed = np.unique(plane)
    for s in placed.tolist():
        values.insert(P(s), gtsam.OrientedPlane3(room.planes[s]).retract(0.02 * rng.normal(size=3)))
        graph.add(plane_prior_factor(P(s), room.planes[s], gtsam.noiseModel.Isotropic.Sigma(3, 0.1)))
    return Problem(graph, landmarks, placed, len(room.planes)), values, start + 0.02 * rng.normal(size=start.shape)


def written_out(
    problem: Problem, values: gtsam.Values, points: FloatArray
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """The same as GTSAM's own factors: observations, ties and priors of every landmark."""
    landmarks, noise = problem.landmarks, gtsam.noiseModel
    graph, both = gtsam.NonlinearFactorGraph(problem.graph), gtsam.Values(values)
    cauchy = noise.mEstimator.Cauchy.Create(landmarks.cauchy)
    for m, n in enumerate(landmarks.owner.tolist()):
        model = noise.Robust.Create(cauchy, noise.Isotropic.Sigma(2, landmarks.sigma_px[m]))
        graph.add(
            gtsam.TriangulationFactorCal3_S2(pinhole(landmarks.projection[m]), landmarks.points_px[m], model, L(n))
        )
    for n, s in enumerate(landmarks.plane.tolist()):
        both.insertPoint3(L(n), points[n])
        graph.add(track_factor(P(s), [L(n)], landmarks.sigma_plane[[n]]))
        prior = noise.Isotropic.Sigma(3, landmarks.sigma_prior)
        graph.add(gtsam.PriorFactorPoint3(L(n), landmarks.prior[n], prior))
    return graph, both


def pinhole(projection: FloatArray) -> gtsam.PinholeCameraCal3_S2:
    R_upper = np.linalg.qr(projection[::-1, :3].T)
    R, upper = R_upper[0].T[::-1], R_upper[1].T[::-1, ::-1]
    signs = np.diag(np.sign(np.diag(upper)))
    R, K = signs @ R, upper @ signs
    center = -np.linalg.solve(projection[:, :3], projection[:, 3])
    pose = gtsam.Pose3(gtsam.Rot3(R.T), center)
    return gtsam.PinholeCameraCal3_S2(pose, gtsam.Cal3_S2(K[0, 0], K[1, 1], K[0, 1], K[0, 2], K[1, 2]))


def test_it_costs_what_the_graph_written_out_costs(problem: tuple[Problem, gtsam.Values, FloatArray]) -> None:
    graph, values = written_out(*problem)
    assert problem[0].error(*problem[1:]) == pytest.approx(graph.error(values), rel=1e-9)


@pytest.mark.parametrize("damping", [1e-5, 1.0])
def test_a_step_is_that_of_the_graph_written_out(
    problem: tuple[Problem, gtsam.Values, FloatArray], damping: float
) -> None:
    of, values, points = problem
    graph, both = written_out(of, values, points)
    ordering = gtsam.Ordering()
    keys = [*(P(s) for s in of.placed.tolist()), *(L(n) for n in range(len(points)))]
    for key in keys:
        ordering.push_back(key)
    information, gradient = graph.linearize(both).hessian(ordering)
    steps = np.linalg.solve(information + damping * np.eye(len(information)), np.ravel(gradient)).reshape(-1, 3)
    new_values, new_points = of.linearise(values, points).stepped(values, points, damping)
    np.testing.assert_allclose(new_points - points, steps[len(of.placed) :], atol=1e-9)
    for s, step in zip(of.placed.tolist(), steps[: len(of.placed)], strict=True):
        expected = values.atOrientedPlane3(P(s)).retract(step).planeCoefficients()
        np.testing.assert_allclose(new_values.atOrientedPlane3(P(s)).planeCoefficients(), expected, atol=1e-9)


def test_a_point_behind_its_cameras_costs_much_and_pulls_nothing(
    problem: tuple[Problem, gtsam.Values, FloatArray], room: Room
) -> None:
    of, values, points = problem
    planes, behind = of.planes(values), points.copy()
    behind[0] = mirrored(room.scene.frames[0].camera, points[0])
    alone = replace(of.landmarks, sigma_plane=np.full(len(points), 1e9), sigma_prior=1e9)
    assert alone.error(planes, behind) > alone.error(planes, points) + 3
    linear = alone.linearise(planes, behind)
    assert np.abs(linear.gradient[0]).max() < 1e-12
    assert np.abs(linear.gradient[1]).max() > 1e-6


def mirrored(camera: Camera, point: FloatArray) -> FloatArray:
    """The other side of a camera, and far enough away to be behind all others."""
    return camera.center_world - 50 * (point - camera.center_world)
