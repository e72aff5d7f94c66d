"""Statistics of predicted covariances, on planes drawn from theirs."""

from __future__ import annotations

import numpy as np
import pytest

from common.consistency import coverage, nees, plane_error_at, rank_correlation, share_of
from gtlayout.instances import Plane, PlaneFrame
from gtlayout.scene import FloatArray

CENTROID = np.array([3.0, -1.0, 2.0])
NORMAL = np.array([0.6, 0.0, 0.8])
AXES = PlaneFrame.across(NORMAL, CENTROID).axes
ROOT = np.array([[0.02, 0.005, 0.003], [0.0, 0.03, -0.004], [0.0, 0.0, 0.01]])
SPREAD = ROOT.T @ ROOT
"""(3, 3) of two tilts (1° to 2°) and the offset (1 cm) at ``CENTROID``, coupled."""


def plane(covariance_scale: float = 1.0) -> Plane:
    """A plane through ``CENTROID`` whose covariance there is ``SPREAD``, written for (normal, d) in the world."""
    to_coefficients = np.zeros((4, 3))
    to_coefficients[:3, :2] = AXES.T
    to_coefficients[3] = np.append(-AXES @ CENTROID, 1.0)
    covariance = covariance_scale * to_coefficients @ SPREAD @ to_coefficients.T
    return Plane(NORMAL, -float(NORMAL @ CENTROID), covariance, observable=True)


def turned(tilts: FloatArray, offset: float) -> tuple[FloatArray, float]:
    """The plane that is off by so much, exactly: the normal on a great circle."""
    angle = float(np.linalg.norm(tilts))
    normal = np.cos(angle) * NORMAL + np.sinc(angle / np.pi) * tilts @ AXES
    return normal, offset - float(normal @ CENTROID)


def drawn(scale: float, count: int = 1500) -> FloatArray:
    errors = np.random.default_rng(0).multivariate_normal(np.zeros(3), SPREAD, count)
    estimate = plane(scale)
    return np.array([nees(*plane_error_at(estimate, *turned(e[:2], e[2]), CENTROID)) for e in errors])


def test_an_error_is_read_back_with_its_covariance() -> None:
    error, covariance = plane_error_at(plane(), *turned(np.array([0.3, -0.4]), 0.02), CENTROID)
    np.testing.assert_allclose(error, [0.3, -0.4, 0.02], atol=1e-12)
    np.testing.assert_allclose(covariance, SPREAD, atol=1e-12)


def test_errors_drawn_from_the_covariance_have_nees_three_and_nominal_coverage() -> None:
    values = drawn(1.0)
    assert values.mean() == pytest.approx(3.0, abs=4 * np.sqrt(6 / len(values)))
    for nominal in (0.5, 0.9, 0.95):
        share = coverage(values, nominal)
        assert share.low < nominal < share.high


def test_a_covariance_of_double_the_size_halves_nees() -> None:
    np.testing.assert_allclose(drawn(2.0), drawn(1.0) / 2, rtol=1e-9)
    assert coverage(drawn(0.25), 0.9).high < 0.5, "σ half as large as it should be"
    assert coverage(drawn(4.0), 0.5).low > 0.8, "… and twice"


def test_nees_is_the_same_at_every_point() -> None:
    """To first order: where the offset is taken is a change of coordinates."""
    true = turned(np.array([1e-4, 2e-4]), 1e-3)
    at = [nees(*plane_error_at(plane(), *true, point)) for point in (CENTROID, CENTROID + 5 * AXES[0])]
    assert at[1] == pytest.approx(at[0], rel=1e-3)


def test_one_sigma_along_each_axis_is_one() -> None:
    variances, axes = np.linalg.eigh(SPREAD)
    for one in np.sqrt(variances)[:, None] * axes.T:
        assert nees(*plane_error_at(plane(), *turned(one[:2], one[2]), CENTROID)) == pytest.approx(1.0, rel=1e-6)


def test_what_nothing_is_known_of_counts_nowhere() -> None:
    assert np.isnan(nees(np.zeros(3), np.full((3, 3), np.nan)))
    assert coverage(np.array([0.1, 100.0, np.nan]), 0.9).value == 0.5
    assert np.isnan(coverage(np.array([np.nan]), 0.9).value)


def test_interval_of_a_share() -> None:
    """Wilson's: (p + z²/2n ± z √(p(1−p)/n + z²/4n²)) / (1 + z²/n)."""
    share, z = share_of(8, 10), 1.959964
    middle, reach = 0.8 + z**2 / 20, z * np.sqrt(0.16 / 10 + z**2 / 400)
    assert share.value == 0.8
    assert (share.low, share.high) == pytest.approx(
        ((middle - reach) / (1 + z**2 / 10), (middle + reach) / (1 + z**2 / 10)), rel=1e-6
    )
    assert share_of(5, 5).high == pytest.approx(1.0)


def test_rank_correlation() -> None:
    """1 − 6 Σd² / n(n²−1), whatever the scale; pairs with a hole are left out."""
    sigma = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    assert rank_correlation(sigma, sigma**5) == pytest.approx(1.0)
    assert rank_correlation(sigma, -sigma) == pytest.approx(-1.0)
    assert rank_correlation(sigma, np.array([10.0, 30.0, 20.0, 50.0, 40.0])) == pytest.approx(1 - 6 * 4 / 120)
    assert rank_correlation(np.append(sigma, np.nan), np.append(sigma, -9.0)) == pytest.approx(1.0)
    assert np.isnan(rank_correlation(sigma, np.ones(5)))
    assert np.isnan(rank_correlation(sigma[:1], sigma[:1]))
