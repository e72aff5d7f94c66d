"""Every factor: answers known in closed form (what holds for all of them is in ``test_factor_properties``)."""

from __future__ import annotations

import gtsam
import numpy as np
import numpy.typing as npt
import pytest
from gtsam.symbol_shorthand import B, C, L, O, P

from gtlayout.factors import (
    EdgeView,
    biased_depth_factor,
    coplanarity_factor,
    cylinder_edge_factor,
    cylinder_track_factor,
    depth_factor,
    edge_factor,
    perpendicularity_factor,
    plane_prior_factor,
    track_factor,
)
from gtlayout.factors.batching import custom_factor

FloatArray = npt.NDArray[np.float64]
CAMERA = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]]) @ np.column_stack(
    [gtsam.Rot3.RzRyRx(0.2, -0.3, 0.1).matrix(), [0.3, -0.2, 0.5]]
)


def test_edge_is_zero_on_the_projected_intersection_and_in_pixels_beside_it() -> None:
    # The planes x = 2 and y = 1 meet in the line (2, 1, z); a camera at the origin looking along z sees it as a line.
    values = gtsam.Values()
    values.insertPoint3(O(0), np.zeros(3))
    values.insert(P(0), gtsam.OrientedPlane3(np.array([-1.0, 0, 0, 2])))
    values.insert(P(1), gtsam.OrientedPlane3(np.array([0, -1.0, 0, 1])))
    K = np.array([[400.0, 0, 300], [0, 400, 200], [0, 0, 1]])
    projection = np.column_stack([K, np.zeros(3)])
    image = [(K @ [2, 1, z] / z)[:2] for z in (4.0, 9.0)]
    along = (image[1] - image[0]) / np.linalg.norm(image[1] - image[0])
    across = np.array([-along[1], along[0]])
    unit = gtsam.noiseModel.Unit.Create(2)

    def error(shift_px: float, tilt_px: float) -> FloatArray:
        points = np.array([image[0] + (shift_px + tilt_px) * across, image[1] + (shift_px - tilt_px) * across])
        whitened: FloatArray = edge_factor((P(0), P(1)), O(0), EdgeView.of(points, projection), unit).whitenedError(
            values
        )
        return whitened

    np.testing.assert_allclose(error(0, 0), 0, atol=1e-9)
    np.testing.assert_allclose(np.abs(error(3, 0)), [3, 0], atol=1e-9)
    np.testing.assert_allclose(np.abs(error(0, 2)), [0, 2], atol=1e-9)
    # Which side of a line is positive is nobody's choice, but both have the same.
    assert np.prod(error(3, 2)) == pytest.approx(6)
    assert np.prod(error(3, -2)) == pytest.approx(-6)


def test_an_offset_moves_the_line_that_the_edge_should_lie_on() -> None:
    """The foot of a baseboard, 2 cm before the wall: in the image there, and along the line no difference."""
    K = np.array([[400.0, 0, 300], [0, 400, 200], [0, 0, 1]])
    values = gtsam.Values()
    values.insert(P(0), gtsam.OrientedPlane3(np.array([-1.0, 0, 0, 2])))
    values.insert(P(1), gtsam.OrientedPlane3(np.array([0, -1.0, 0, 1])))
    values.insertPoint3(O(0), np.array([-0.02, 0.01, 5.0]))
    points = np.array([(K @ [1.98, 1.01, z] / z)[:2] for z in (4.0, 9.0)])
    projection = np.column_stack([K, np.zeros(3)])
    factor = edge_factor((P(0), P(1)), O(0), EdgeView.of(points, projection), gtsam.noiseModel.Unit.Create(2))
    np.testing.assert_allclose(factor.whitenedError(values), 0, atol=1e-9)
    jacobian, _ = factor.linearize(values).jacobian()
    np.testing.assert_allclose(jacobian[:, 6:] @ [0, 0, 1], 0, atol=1e-9)


def test_edge_of_coincident_planes_says_nothing() -> None:
    values = gtsam.Values()
    values.insertPoint3(O(0), np.zeros(3))
    for key in (P(0), P(1)):
        values.insert(key, gtsam.OrientedPlane3(np.array([0, 0, -1.0, 3])))
    factor = edge_factor(
        (P(0), P(1)), O(0), EdgeView.of(np.array([[10.0, 20], [30, 40]]), CAMERA), gtsam.noiseModel.Unit.Create(2)
    )
    jacobian, error = factor.linearize(values).jacobian()
    assert jacobian.shape == (2, 9)
    assert not jacobian.any()
    assert not error.any()


@pytest.mark.parametrize(("angle", "says_something"), [(0.005, False), (0.02, True)])
def test_edge_of_nearly_coincident_planes_says_nothing_below_a_hundredth_radian(
    angle: float, says_something: bool
) -> None:
    values = gtsam.Values()
    values.insertPoint3(O(0), np.zeros(3))
    values.insert(P(0), gtsam.OrientedPlane3(np.array([0, 0, -1.0, 3])))
    values.insert(P(1), gtsam.OrientedPlane3(np.array([np.sin(angle), 0, -np.cos(angle), 3 * np.cos(angle)])))
    K = np.array([[400.0, 0, 300], [0, 400, 200], [0, 0, 1]])
    projection = np.column_stack([K, np.zeros(3)])
    factor = edge_factor(
        (P(0), P(1)), O(0), EdgeView.of(np.array([[10.0, 20], [30, 40]]), projection), gtsam.noiseModel.Unit.Create(2)
    )
    # They meet in x = 0, seen as the column x = 300.
    expected = np.array([280.0, 10.0]) if says_something else np.zeros(2)
    np.testing.assert_allclose(np.abs(factor.whitenedError(values)), expected, atol=1e-6)


def test_edge_whose_line_lies_beside_the_camera_says_nothing() -> None:
    """Planes that meet in (1, y, 0), in the camera's own focal plane: their line is nowhere in the image."""
    values = gtsam.Values()
    values.insertPoint3(O(0), np.zeros(3))
    values.insert(P(0), gtsam.OrientedPlane3(np.array([-1.0, 0, 0, 1])))
    values.insert(P(1), gtsam.OrientedPlane3(np.array([-1.0, 0, -1, 1]) / np.sqrt(2)))
    projection = np.column_stack([np.eye(3), np.zeros(3)])
    factor = edge_factor(
        (P(0), P(1)), O(0), EdgeView.of(np.array([[0.1, 0.2], [0.3, 0.4]]), projection), gtsam.noiseModel.Unit.Create(2)
    )
    jacobian, error = factor.linearize(values).jacobian()
    assert not jacobian.any()
    assert not error.any()


def test_perpendicularity_is_the_sine_of_the_deviation() -> None:
    values = gtsam.Values()
    tilt = np.deg2rad(7)
    values.insert(P(0), gtsam.OrientedPlane3(np.array([0, 0, 1.0, 0])))
    values.insert(P(1), gtsam.OrientedPlane3(np.array([np.cos(tilt), 0, np.sin(tilt), 1])))
    factor = perpendicularity_factor((P(0), P(1)), gtsam.noiseModel.Unit.Create(1))
    np.testing.assert_allclose(factor.whitenedError(values), [np.sin(tilt)])


def test_coplanarity_is_the_angle_and_the_distance_at_the_point() -> None:
    values = gtsam.Values()
    values.insert(P(0), gtsam.OrientedPlane3(np.array([0, 0, 1.0, -2.1])))
    values.insert(P(1), gtsam.OrientedPlane3(np.array([0, np.sin(0.1), np.cos(0.1), -2.0])))
    factor = coplanarity_factor((P(0), P(1)), np.array([5.0, 0, 2.0]), gtsam.noiseModel.Unit.Create(4))
    error = factor.whitenedError(values)
    np.testing.assert_allclose(np.linalg.norm(error[:3]), np.sin(0.1))
    np.testing.assert_allclose(error[3], -0.1 - (2.0 * np.cos(0.1) - 2.0))


def test_depth_is_zero_on_the_plane_and_an_inverse_length_off_it() -> None:
    values = gtsam.Values()
    values.insert(P(0), gtsam.OrientedPlane3(np.array([0, 0, -1.0, 4.0])))
    centers, rays = np.array([[0, 0, 0], [1, 2, 2.0]]), np.array([[0.3, -0.2, 1], [-0.1, 0.4, 1.0]])
    factor = depth_factor(P(0), centers, rays, np.array([1 / 4, 1 / 1.6]), gtsam.noiseModel.Unit.Create(2))
    np.testing.assert_allclose(factor.whitenedError(values), [0, 1 / 1.6 - 1 / 2], atol=1e-12)


def test_depth_of_a_plane_through_the_camera_is_finite() -> None:
    values = gtsam.Values()
    values.insert(P(0), gtsam.OrientedPlane3(np.array([1.0, 0, 0, 0])))
    rays = np.array([[0.5, 0.0, 1.0]])
    factor = depth_factor(P(0), np.zeros((1, 3)), rays, np.array([0.25]), gtsam.noiseModel.Unit.Create(1))
    jacobian, _ = factor.linearize(values).jacobian()
    np.testing.assert_allclose(factor.whitenedError(values), [0.25 + 0.5 / 1e-6])
    assert np.isfinite(jacobian).all()


def test_prior_is_zero_where_it_says_and_its_parts_are_those_of_the_tangent() -> None:
    prior = np.array([0.0, 0.6, -0.8, 2.5])
    factor = plane_prior_factor(P(0), prior, gtsam.noiseModel.Unit.Create(3))
    values = gtsam.Values()
    values.insert(P(0), gtsam.OrientedPlane3(prior))
    np.testing.assert_allclose(factor.whitenedError(values), 0.0, atol=1e-12)
    normal = np.array([0.28, 0.0, 0.96])
    values.update(P(0), gtsam.OrientedPlane3(np.append(normal, 2.8)))
    tangent = gtsam.Unit3(prior[:3]).basis().T @ normal
    np.testing.assert_allclose(factor.whitenedError(values), [*tangent, 0.3], atol=1e-12)


def test_points_that_are_off_together_lie_on_the_plane_once_their_bias_is_known() -> None:
    values = gtsam.Values()
    values.insert(P(0), gtsam.OrientedPlane3(np.array([0, 0, -1.0, 4.0])))
    values.insertPoint3(B(0), np.array([0.02, 0.0, -0.01]))
    rays = np.column_stack([np.zeros((2, 2)), np.ones(2)])
    bias_by = np.array([[1.0, 0.3, 0.0], [1.0, 0.0, 2.0]]) / 4
    factor = biased_depth_factor(
        (P(0), B(0)), np.zeros((2, 3)), rays, np.array([1.02 / 4, 1.0 / 4]), bias_by, gtsam.noiseModel.Unit.Create(2)
    )
    np.testing.assert_allclose(factor.whitenedError(values), 0, atol=1e-12)


def test_marginal_of_a_plane_fitted_to_known_points_is_least_squares() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (40, 2)), np.zeros(40)])
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, point in enumerate(points):
        graph.add(gtsam.PriorFactorPoint3(L(i), point, gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
        values.insertPoint3(L(i), point)
    graph.add(track_factor(P(0), [L(i) for i in range(40)], np.full(40, 0.01)))
    values.insert(P(0), gtsam.OrientedPlane3(np.array([0, 0, 1.0, 0])))
    rows = np.column_stack([points @ gtsam.Unit3(np.array([0, 0, 1.0])).basis(), np.ones(40)])
    expected = np.linalg.inv(rows.T @ rows) * 0.01**2
    np.testing.assert_allclose(gtsam.Marginals(graph, values).marginalCovariance(P(0)), expected, rtol=1e-4)


def test_wrong_shapes_are_named() -> None:
    def residual(_: gtsam.Values, __: bool) -> tuple[FloatArray, list[FloatArray]]:
        return np.zeros(2), [np.zeros((1, 3))]

    factor = custom_factor(gtsam.noiseModel.Unit.Create(1), [P(0)], residual)
    values = gtsam.Values()
    values.insert(P(0), gtsam.OrientedPlane3(np.array([0, 0, 1.0, 0])))
    with pytest.raises(ValueError, match="residual has shape"):
        factor.linearize(values)


def test_points_on_a_cylinder_and_on_its_foot_have_no_error_and_others_their_distance() -> None:
    """A cylinder of radius 2 about (1, 0), that leans by 0.1 towards x, on a floor at z = -1."""
    values = gtsam.Values()
    values.insert(C(0), np.array([1.0, 0, 2, 0.1, 0]))
    values.insert(P(0), gtsam.OrientedPlane3(np.array([0, 0, 1.0, 1])))
    origin, axes = np.zeros(3), np.eye(3)
    points = np.array([[3.0, 0, 0], [1, 2, 0], [3.1, 0, 1], [3.5, 0, 0], [1, 1.5, 0]])
    track = cylinder_track_factor(C(0), origin, axes, points, gtsam.noiseModel.Unit.Create(5))
    np.testing.assert_allclose(track.whitenedError(values), [0, 0, 0, 0.5, -0.5], atol=1e-12)
    center = np.array([0.5, 0.2, 1.0])
    foot = np.array([[2.9, 0, -1], [0.9, 2, -1], [3.2, 0, -1]])
    rays = 0.3 * (foot - center)
    edge = cylinder_edge_factor(
        (C(0), P(0)), origin, axes, np.tile(center, (3, 1)), rays, gtsam.noiseModel.Unit.Create(3)
    )
    np.testing.assert_allclose(edge.whitenedError(values), [0, 0, 0.3], atol=1e-12)
