"""Where rays meet planes, and σ of what is linear: closed forms."""

from __future__ import annotations

import numpy as np

from gtlayout.geometry.rays import depth_on_plane, inverse_depth_on_plane, nonzero
from gtlayout.instances import propagated_sigma


def test_depths_are_where_the_rays_meet_the_plane() -> None:
    rng = np.random.default_rng(0)
    normal, d = np.array([0.0, 0.6, -0.8]), 2.0
    centers, rays = rng.normal(size=(50, 3)), rng.normal(size=(50, 3))
    depth = depth_on_plane(centers @ normal + d, rays @ normal)
    np.testing.assert_allclose((centers + depth[:, None] * rays) @ normal + d, 0.0, atol=1e-12)
    np.testing.assert_allclose(inverse_depth_on_plane(centers @ normal + d, rays @ normal), 1 / depth)


def test_rays_along_a_plane_and_starts_on_it_are_finite() -> None:
    along, on_it = np.array([0.0]), np.array([0.0])
    assert depth_on_plane(np.array([1.0]), along)[0] == -1e12
    assert inverse_depth_on_plane(on_it, np.array([1.0]))[0] == -1e12
    assert np.array_equal(nonzero(np.array([0.0, 1e-13, -1e-13, 1e-11, -2.0])), [1e-12, 1e-12, 1e-12, 1e-11, -2.0])


def test_propagated_sigma_is_the_root_of_the_quadratic_form() -> None:
    covariance = np.array([[4.0, 1.0], [1.0, 9.0]])
    gradients = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]])
    np.testing.assert_allclose(propagated_sigma(gradients, covariance), [2.0, 3.0, np.sqrt(11.0)])
    assert propagated_sigma(np.ones(2), covariance) == np.sqrt(15.0)
    # Negative but for rounding.
    assert propagated_sigma(np.ones(2), np.array([[1.0, -1.0], [-1.0, 1.0 - 1e-15]])) == 0.0
